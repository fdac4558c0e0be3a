"""Settings of the documentation site: `make site`. Pages are those of docs/, the API comes from docstrings."""

import os

from halpipe import __version__

project = "halpipe"
author = "the authors of halpipe"
project_copyright = "the authors of halpipe"
release = version = os.environ.get("SITE_VERSION", __version__)
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
templates_path = ["templates"]
html_sidebars = {
    "**": [
        *("sidebar/brand.html", "versions.html", "sidebar/search.html"),
        *("sidebar/scroll-start.html", "sidebar/navigation.html", "sidebar/scroll-end.html"),
    ]
}
nitpicky = False
suppress_warnings = ["myst.strikethrough"]
