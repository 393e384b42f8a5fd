"""Configuration of the documentation site: ``sphinx-build -W docs site``."""

import importlib
import importlib.metadata
import shutil
import sys
import tempfile
from pathlib import Path

import latex2mathml.converter
from docutils import nodes
from sphinx.errors import ExtensionError
from sphinx.pycode import ModuleAnalyzer

import evac

sys.path.insert(0, str(Path(__file__).parent))
tables = importlib.import_module("tables")

project = "evac"
author = "the evac developers"
project_copyright = author
release = importlib.metadata.version("evac")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]

# Markdown as it stands on GitHub: links to headings by their text.
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]

# Notebooks are kept without output and are executed at every build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_in_temp = True

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True  # attributes of several classes have the same name
autosummary_generate = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_title = f"evac {release}"
html_show_sphinx = False
html_math_renderer = "mathml"
html_theme_options = {
    "source_repository": "",
    "footer_icons": [],
    "top_of_page_buttons": [],
}
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_js_files = ["wide.js"]


def _formula(translator, node, display):
    """Write a formula as MathML, which browsers set without a script and without a network."""
    written = latex2mathml.converter.convert(node.astext(), display=display)
    if "\\" in written:
        raise ExtensionError(f"latex2mathml does not know a command of {node.astext()!r}")
    translator.body.append(written)
    raise nodes.SkipNode


def _give_captions_a_level(app, page, template, context, doctree):
    """Give the captions of the contents, which the theme declares as headings, the level that headings must have."""
    contents = context["furo_navigation_tree"]
    context["furo_navigation_tree"] = contents.replace('role="heading"', 'role="heading" aria-level="2"')


#: Fields of the class that is documented now, which are listed below its docstring.
FIELDS: set[str] = set()


def _list_fields(app, what, name, item, options, lines):
    """List the fields of a class, which have their meanings as comments (#:) where they are declared."""
    if what in ("class", "exception", "module"):
        FIELDS.clear()
    if what == "class" and item is not evac.Results:  # whose fields have docstrings
        known = ModuleAnalyzer.for_module(item.__module__).find_attr_docs()
        own = {field: " ".join(text) for (cls, field), text in known.items() if cls == item.__qualname__}
        lines += ["", *(f":ivar {field}: {text}" for field, text in own.items())]
        FIELDS.update(own)


def _fill(app, name, source):
    """Put the tables that the code knows in the places of their marks."""
    source[0] = tables.filled(source[0])


def _with_tables(app, environment, *changes):
    """Return the pages with tables, which change with the code."""
    return {
        name
        for name in environment.found_docs
        if tables.MARK.search(Path(environment.doc2path(name)).read_text("utf-8"))
    }


def _write_replay(app, exception):
    """Write the replay that the first page shows."""
    if exception is None and app.builder.format == "html":
        with tempfile.TemporaryDirectory() as folder:
            evac.run(evac.load("primary_school"), Path(folder, "school"))
            shutil.copy(Path(folder, "school/replay.html"), app.outdir)


def setup(app):
    """Register what this site adds to Sphinx."""
    app.add_html_math_renderer(
        "mathml",
        (lambda translator, node: _formula(translator, node, "inline"), None),
        (lambda translator, node: _formula(translator, node, "block"), None),
    )
    app.connect("source-read", _fill)
    app.connect("autodoc-process-docstring", _list_fields)
    app.connect("autodoc-skip-member", lambda app, what, name, *others: name in FIELDS or None)
    app.connect("env-get-outdated", _with_tables)
    app.connect("html-page-context", _give_captions_a_level, priority=600)  # after the theme
    app.connect("build-finished", _write_replay)
