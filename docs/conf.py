"""The documentation as a site: python -m sphinx -W docs FOLDER, offline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
for package in ("bmd_rths_core", "bmd_rths_msgs_py", "bmd_rths_nodes"):
    sys.path.insert(0, str(ROOT / package))

from bmd_rths_core.version import __version__  # noqa: E402 - found beside this file, installed or not

project = "bmd_rths"
author = "The bmd_rths authors"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "sphinx_click"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["index.md", "layouts"]  # `site/index` has its words, and what stands where
root_doc = "site/index"

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
# What stands beside the pages in the repository (sources, configurations) is no part of the site.
suppress_warnings = ["myst.xref_missing"]

autodoc_typehints = "none"  # numpydoc says types, shapes and units
numpydoc_show_class_members = False
autosummary_generate = False

html_theme = "furo"
html_title = "bmd_rths"
html_static_path: list[str] = []
html_copy_source = False
html_theme_options: dict[str, Any] = {"top_of_page_buttons": []}


def setup(app: Sphinx) -> None:
    """Show diagrams in Mermaid as text: a page that draws them would have to load a script from elsewhere."""
    app.add_lexer("mermaid", TextLexer)
