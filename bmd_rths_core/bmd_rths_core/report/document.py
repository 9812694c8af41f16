"""A report as a list of blocks, which become a web page or the pages of a PDF file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from bmd_rths_core.plots.layout import Canvas


class Drawing(Protocol):
    """A figure that knows what it shows, how high it has to be and how it is drawn."""

    @property
    def height(self) -> float:
        """Height it needs, two columns of a journal wide [mm]."""

    def draw(self, figure: Canvas) -> None:
        """Draw in the present style of matplotlib.

        Parameters
        ----------
        figure : Figure or SubFigure
            Empty.
        """


@dataclass(frozen=True)
class Paragraph:
    """Some sentences.

    Parameters
    ----------
    text : str
        Plain text.
    """

    text: str


@dataclass(frozen=True)
class Table:
    """A table of text.

    Parameters
    ----------
    header : tuple of str
        Names of the columns; the first column is text, the others are numbers.
    rows : tuple of tuple of str
        One cell for each column.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A figure.

    Parameters
    ----------
    drawing : Drawing
        What it shows.
    caption : str
        What is to be seen.
    """

    drawing: Drawing
    caption: str


@dataclass(frozen=True)
class Folded:
    """Long text that is folded where that is possible.

    Parameters
    ----------
    title : str
        What it is.
    text : str
        Lines, shown as they are.
    """

    title: str
    text: str


Block = Paragraph | Table | Picture | Folded


def shown(drawing: Drawing | str, caption: str) -> Block:
    """Return a figure with its caption, or why there is none."""
    return Paragraph(f"Cannot be shown: {drawing}.") if isinstance(drawing, str) else Picture(drawing, caption)


@dataclass(frozen=True)
class Section:
    """A heading and what stands below it.

    Parameters
    ----------
    title : str
        The heading.
    blocks : tuple of Block
        From the top.
    """

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Document:
    """A whole report.

    Parameters
    ----------
    title : str
        What it is about.
    verdict : str
        Sentence that states the outcome.
    good : bool
        True when nothing was wrong.
    notes : tuple of str
        What was wrong, and what has to be known; below the verdict.
    sections : tuple of Section
        From the top.
    """

    title: str
    verdict: str
    good: bool
    notes: tuple[str, ...]
    sections: tuple[Section, ...]
