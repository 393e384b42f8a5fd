"""Configuration of the documentation site: ``sphinx-build -W docs site``."""

import importlib.metadata

project = "evac"
author = "the evac developers"
project_copyright = author
release = importlib.metadata.version("evac")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
]

# Markdown as it stands on GitHub: links to headings by their text.
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist"]

# Notebooks are kept without output and are executed at every build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_execution_in_temp = True

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False
autosummary_generate = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "furo"
html_title = f"evac {release}"
html_show_sphinx = False
# Equations are drawn by MathJax from the page's own folder or not at all: no page asks a network for anything else.
html_theme_options = {
    "source_repository": "",
    "footer_icons": [],
}
