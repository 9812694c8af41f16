"""A report as one web page that needs nothing else: no network, no script, figures inside."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from string import Template

from bmd_rths_core.plots.svg import svg
from bmd_rths_core.report.document import Block, Document, Folded, Paragraph, Section, Table

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff; margin: 0 auto; max-width: 56rem;
  padding: 1rem; }
h1 { font-size: 1.5rem; margin: 0 0 .5rem; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; border-bottom: 1px solid #ccc; break-after: avoid; }
p { margin: .5rem 0; overflow-wrap: anywhere; }
.verdict { border-left: .4rem solid #d55e00; background: #fdf3ec; padding: .5rem 1rem; }
.verdict.good { border-color: #009e73; background: #edf8f4; }
.verdict > p { font-weight: 600; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .5rem 0 1rem; font-size: .92rem; }
th, td { padding: .2rem .8rem .2rem 0; text-align: right; border-bottom: 1px solid #e5e5e5; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; white-space: normal; overflow-wrap: anywhere; min-width: 8rem; }
figure { margin: 1rem 0; break-inside: avoid; }
figure img { width: 100%; min-width: 38rem; height: auto; display: block; }
figcaption { color: #444; font-size: .9rem; }
pre { font-size: .8rem; overflow-x: auto; background: #f6f6f6; padding: .5rem; }
@media print { body { max-width: none; padding: 0; font-size: 10pt; } figure img { min-width: 0; } }
"""

_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>$title</title>
<style>$style</style>
</head>
<body>
<h1>$title</h1>
<div class="verdict$good"><p>$verdict</p>
$notes</div>
$sections
</body>
</html>
""")


def page_of(document: Document) -> str:
    """Return a report as HTML.

    Parameters
    ----------
    document : Document
        The report.
    """
    return _PAGE.substitute(
        title=escape(document.title),
        style=_STYLE,
        good=" good" if document.good else "",
        verdict=escape(document.verdict),
        notes=_notes(document.notes),
        sections="\n".join(_section(section) for section in document.sections),
    )


def _notes(notes: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<ul>{items}</ul>" if items else ""


def _section(section: Section) -> str:
    blocks = "\n".join(_block(block, f"{section.title}: figure") for block in section.blocks)
    return f"<section>\n<h2>{escape(section.title)}</h2>\n{blocks}\n</section>"


def _block(block: Block, name: str) -> str:
    if isinstance(block, Paragraph):
        return f"<p>{escape(block.text)}</p>"
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Folded):
        return f"<details><summary>{escape(block.title)}</summary><pre>{escape(block.text)}</pre></details>"
    # As an image, the names inside one figure cannot meet those of another.
    image = base64.b64encode(svg(block.drawing.draw, block.drawing.height)).decode()
    source = f'<img alt="{escape(name)}" src="data:image/svg+xml;base64,{image}">'
    return f'<figure><figcaption>{escape(block.caption)}</figcaption><div class="wide">{source}</div></figure>'


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    rows = "\n".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div>'
