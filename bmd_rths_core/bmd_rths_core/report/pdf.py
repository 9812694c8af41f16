"""A report as the pages of a PDF file."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from bmd_rths_core.plots.style import style
from bmd_rths_core.report.document import Block, Document, Drawing, Folded, Paragraph, Picture, Table

#: Sheet and margins [mm].
_WIDTH, _HEIGHT, _MARGIN = 210.0, 297.0, 15.0

#: Height for the pieces of a sheet [mm].
_USABLE = _HEIGHT - 2.0 * _MARGIN

#: Height of a line of text [mm], and characters in it: 8 pt.
_LINE, _CHARACTERS = 4.2, 112

#: Width of the first column of a table, of all its columns, and the largest of any other column [mm].
_FIRST, _ALL, _OTHER = 60.0, 180.0, 32.0

#: Characters in the first column of a table, and width of one in its header, which is 7 pt [mm].
_NAME, _BOLD = 42, 1.6

#: Height of a line of folded text [mm]: 6 pt.
_SMALL = 2.9


@dataclass(frozen=True)
class _Piece:
    """Something that stands on one sheet."""

    height: float
    lines: tuple[str, ...] = ()
    size: float = 8.0
    weight: str = "normal"
    cells: tuple[str, ...] = ()
    keep: bool = False  # on the sheet of the next piece
    drawing: Drawing | None = None


def write_pdf(document: Document, path: Path) -> None:
    """Write a report as a PDF file of A4 sheets.

    Parameters
    ----------
    document : Document
        The report.
    path : Path
        The file.
    """
    with style(), PdfPages(path, metadata={"CreationDate": None, "Title": document.title}) as pages:
        sheets = list(_sheets(_pieces(document)))
        for number, sheet in enumerate(sheets, 1):
            figure = _drawn(sheet)
            foot = f"{number} / {len(sheets)}"
            figure.text(0.5, 0.5 * _MARGIN / _HEIGHT, foot, horizontalalignment="center", fontsize=8.0)
            pages.savefig(figure, dpi=200)


def _sheets(pieces: Iterator[_Piece]) -> Iterator[list[_Piece]]:
    """Fill one sheet after the other."""
    sheet: list[_Piece] = []
    together: list[_Piece] = []
    for piece in pieces:
        together.append(piece)
        if piece.keep:
            continue
        if sheet and _height((*sheet, *together)) > _USABLE:
            yield sheet
            sheet = []
        sheet += together
        together = []
    yield sheet + together


def _pieces(document: Document) -> Iterator[_Piece]:
    """Yield the pieces of a document; a heading stays with what stands below it, up to the first figure."""
    yield _text(document.title, size=14.0, weight="bold")
    yield _text(document.verdict, size=10.0, weight="bold")
    for note in document.notes:
        yield _text(f"• {note}")
    for section in document.sections:
        pieces = [_Piece(3.0, keep=True), _text(section.title, size=10.0, weight="bold", keep=True)]
        for block in section.blocks:
            pieces += _block(block)
        first = next((i for i, piece in enumerate(pieces) if piece.drawing is not None), 0)
        together = _height(pieces[: first + 1]) <= _USABLE
        yield from (replace(piece, keep=True) if together and i < first else piece for i, piece in enumerate(pieces))


def _block(block: Block) -> Iterator[_Piece]:
    if isinstance(block, Paragraph):
        yield _text(block.text)
    elif isinstance(block, Table):
        yield _header(block.header)
        yield from (_row(row) for row in block.rows)
        yield _Piece(2.0)
    elif isinstance(block, Picture):
        yield _text(block.caption, keep=True)
        yield _Piece(block.drawing.height + 4.0, drawing=block.drawing)
    elif isinstance(block, Folded):
        yield _text(block.title, keep=True)
        for line in block.text.splitlines():
            yield from (_Piece(_SMALL, lines=(part,), size=6.0) for part in textwrap.wrap(line, 160) or [""])


def _header(cells: tuple[str, ...]) -> _Piece:
    characters = int(_column(cells) / _BOLD)
    lines = [textwrap.wrap(cell, characters, break_long_words=False) for cell in cells[1:]]
    height = _LINE * max((len(cell) for cell in lines), default=1)
    return _Piece(height, cells=(cells[0], *("\n".join(cell) for cell in lines)), size=7.0, weight="bold", keep=True)


def _column(cells: tuple[str, ...]) -> float:
    """Return the width of every column but the first [mm]."""
    return min(_OTHER, (_ALL - _FIRST) / max(len(cells) - 1, 1))


def _row(cells: tuple[str, ...]) -> _Piece:
    name = textwrap.wrap(cells[0], _NAME)
    return _Piece(_LINE * max(len(name), 1), cells=("\n".join(name), *cells[1:]))


def _height(pieces: Sequence[_Piece]) -> float:
    return sum(piece.height for piece in pieces)


def _text(text: str, size: float = 8.0, weight: str = "normal", keep: bool = False) -> _Piece:
    lines = tuple(textwrap.wrap(text, int(_CHARACTERS * 8.0 / size)))
    return _Piece(len(lines) * _LINE * size / 8.0 + 1.0, lines, size, weight, keep=keep)


def _drawn(sheet: list[_Piece]) -> Figure:
    """Return a sheet with its pieces from the top."""
    figure = Figure(figsize=(_WIDTH / 25.4, _HEIGHT / 25.4))
    heights = [piece.height for piece in sheet]
    grid = figure.add_gridspec(
        len(sheet) + 2,
        3,
        wspace=0.0,
        hspace=0.0,
        height_ratios=(_MARGIN, *heights, _HEIGHT - _MARGIN - sum(heights)),
        width_ratios=(_MARGIN, _WIDTH - 2.0 * _MARGIN, _MARGIN),
    )
    top = _HEIGHT - _MARGIN
    for row, piece in enumerate(sheet, 1):
        if piece.drawing is not None:
            piece.drawing.draw(figure.add_subfigure(grid[row, 1]))
        _write(figure, piece, top / _HEIGHT)
        top -= piece.height
    return figure


def _write(figure: Figure, piece: _Piece, y: float) -> None:
    """Write the text of a piece; the first cell of a row is text, the others are numbers."""
    look: dict[str, Any] = {"verticalalignment": "top", "fontsize": piece.size, "fontweight": piece.weight}
    if piece.lines:
        figure.text(_MARGIN / _WIDTH, y, "\n".join(piece.lines), linespacing=1.3, **look)
    column = _column(piece.cells)
    for i, cell in enumerate(piece.cells):
        x = _MARGIN + (_FIRST + column * i if i else 0.0)
        figure.text(x / _WIDTH, y, cell, horizontalalignment="right" if i else "left", **look)
