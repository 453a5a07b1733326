"""Configure `make docs`: Sphinx reads Markdown by MyST, and fetches nothing."""

from __future__ import annotations

import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / "extensions")]

import warehouse_env  # noqa: E402

project = "warehouse_env"
author = "warehouse_env contributors"
copyright = author
version = release = warehouse_env.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton", "mathml", "generated"]
exclude_patterns = ["extensions"]
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # types of other libraries have no page here

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_missing_local"]

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
maximum_signature_line_length = 90  # characters; longer ones have a line per argument
autoclass_content = "both"  # include the docstring of __init__
autodoc_member_order = "bysource"
default_role = "literal"  # of text in backticks in docstrings

html_math_renderer = "mathml"
html_theme = "furo"
html_title = "warehouse_env"
html_copy_source = False
html_static_path = ["static"]
html_css_files = ["wide.css"]
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
