"""Directive ``plugins KIND``: everything registered of a kind, with its docstring and its parameters."""

import inspect
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.ext.napoleon import NumpyDocstring
from sphinx.util.docutils import SphinxDirective
from sphinx.util.typing import ExtensionMetadata

from evac.registry import Registry


class PluginTables(SphinxDirective):
    """Show every plugin of a kind: its name, what it does, and a table of its parameters."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return a section for each plugin of the kind."""
        kind = self.arguments[0]
        sections: list[nodes.Node] = []
        for name, plugin in sorted(getattr(Registry(), kind).items()):
            section = nodes.section(ids=[nodes.make_id(f"{kind}-{name}")])
            section += nodes.title(text=name)
            section += self.parse_text_to_nodes(f"```{{eval-rst}}\n{self._description(plugin)}\n```")
            section += self.parse_text_to_nodes(_parameters(plugin))
            sections.append(section)
        return sections

    def _description(self, plugin: type[Any]) -> str:
        """Return the docstring of a class as reStructuredText."""
        return str(NumpyDocstring(inspect.getdoc(plugin) or "", self.config, what="class"))


def _parameters(plugin: type[Any]) -> str:
    """Return the parameters of a plugin as a Markdown table."""
    declared = plugin.declared()
    if not declared:
        return "It has no parameters."
    rows = [
        f"| `{name}` | `{one.default!r}` | {one.unit} | {one.range} | {one.doc} |" for name, one in declared.items()
    ]
    return "\n".join(["| parameter | default | unit | allowed | meaning |", "|---|---|---|---|---|", *rows])


def setup(app: Sphinx) -> ExtensionMetadata:
    """Register the directive."""
    app.add_directive("plugins", PluginTables)
    return {"parallel_read_safe": True}
