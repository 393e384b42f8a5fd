"""The descriptions of all registered plugins and of their parameters, generated from their declarations."""

import inspect
import re
from typing import Any

from evac import conformance
from evac.base.parameters import Configurable
from evac.base.toml import toml_value
from evac.contract import hooks as declared_hooks
from evac.contract.registry import Registry

#: Sections of docstrings that are for programmers only.
LEFT_OUT = ("Parameters", "Attributes", "Raises", "Examples", "Returns")


#: Formulas of docstrings, which terminals show as they are, in TeX.
FORMULAS = {
    "a exp((l - s) / D)": r"a\, e^{(l - s) / D}",
    "min(v, max(0, (s - l) / T))": r"\min\left(v,\ \max\left(0,\ \frac{s - l}{T}\right)\right)",
    "A exp(-D / B) [Lambda + (1 - Lambda) (1 + cos phi) / 2]": (
        r"A\, e^{-D / B} \left[\Lambda + (1 - \Lambda)\, \frac{1 + \cos\varphi}{2}\right]"
    ),
}


def plugins(kind: str) -> str:
    """Return the descriptions of all registered plugins of a kind in Markdown."""
    registered = sorted(getattr(Registry(), kind).items())
    return "\n\n".join(f"### {name}\n\n{_description(one)}\n\n{_parameters(one)}" for name, one in registered)


def hooks() -> str:
    """Return the hooks with their signatures and docstrings as a list in Markdown."""
    rows = []
    for name, hook in vars(declared_hooks).items():
        if name.startswith("evac_"):
            signature = re.sub(r"'|collections\.abc\.|pathlib\.|typing\.", "", str(inspect.signature(hook)))
            rows.append(f"- `{name}{signature}`: {inspect.getdoc(hook)}")
    return "\n".join(rows)


def checks() -> str:
    """Return the checks of plugins as a table in Markdown, by base class."""
    rows = ["| base class | check | what it checks |", "|---|---|---|"]
    for kind, check in (*conformance.IN_A_CASE[::-1], *conformance.ALONE):
        text = (inspect.getdoc(check) or "").partition("\n")[0].removeprefix("Check that ").removesuffix(".")
        base = "all" if kind is Configurable else f"`{kind.__name__}`"
        rows.append(f"| {base} | `{check.__name__}` | {text} |")
    return "\n".join(rows)


def _description(plugin: type[Any]) -> str:
    """Return the docstring of a class in Markdown, without the sections for programmers."""
    text, *sections = re.split(r"\n\n(\w+)\n-{3,}\n", inspect.getdoc(plugin) or "")
    for head, content in zip(sections[::2], sections[1::2], strict=True):
        if head not in LEFT_OUT:
            text += f"\n\n{head}: {content}"
    return re.sub(r"^    (.+)$", _formula, text.replace("``", "`"), flags=re.MULTILINE)


def _formula(line: re.Match[str]) -> str:
    """Return a line that is a formula in TeX."""
    return f"$$\n{FORMULAS[line[1]]}\n$$"


def _parameters(plugin: type[Any]) -> str:
    """Return the parameters of a plugin as a Markdown table."""
    declared = plugin.declared()
    if not declared:
        return "It has no parameters."
    rows = ["| parameter | default | unit | allowed | meaning |", "|---|---|---|---|---|"]
    for name, one in declared.items():
        default = "none" if one.default is None else f"`{toml_value(one.default)}`"
        rows.append(f"| `{name}` | {default} | {one.unit} | {one.range} | {one.doc} |")
    return "\n".join(rows)
