"""The documentation as a site: python -m sphinx -W docs FOLDER, offline."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
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
exclude_patterns = ["index.md", "layouts", "site/static"]  # `site/index` has its words, and what stands where
root_doc = "site/index"

myst_enable_extensions = ["dollarmath", "tasklist"]
myst_heading_anchors = 3
highlight_language = "none"  # a block without a language is what a command prints
# What stands beside the pages in the repository (sources, configurations) is no part of the site.
suppress_warnings = ["myst.xref_missing"]

autodoc_typehints = "none"  # numpydoc says types, shapes and units
numpydoc_show_class_members = False
autosummary_generate = False

html_theme = "furo"
html_math_renderer = "mathml"  # browsers draw it themselves; MathJax would be a script from elsewhere
html_title = "bmd_rths"
html_static_path = ["site/static"]
html_css_files = ["page.css"]
html_show_copyright = False
html_copy_source = False
html_theme_options: dict[str, Any] = {"top_of_page_buttons": []}


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Write formulas as MathML, and diagrams in Mermaid as text: drawing them needs a script from elsewhere."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    app.add_lexer("mermaid", TextLexer)
