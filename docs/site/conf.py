"""The documentation site: `make site`. Pages are those of docs/, the API comes from docstrings."""

from halpipe import __version__

project = "halpipe"
author = "the authors of halpipe"
project_copyright = "the authors of halpipe"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = "halpipe"
html_show_sphinx = False
myst_heading_anchors = 4
myst_enable_extensions = ["deflist"]
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
default_role = "code"
exclude_patterns = ["_build"]
html_static_path = []
nitpicky = False
suppress_warnings = ["myst.strikethrough"]
