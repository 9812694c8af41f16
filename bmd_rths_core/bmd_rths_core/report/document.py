"""A report as a list of blocks, which become a web page or the pages of a PDF file."""

from __future__ import annotations

from dataclasses import dataclass

from bmd_rths_core.report.energy import EnergyHistory
from bmd_rths_core.report.forces import InterfaceForces
from bmd_rths_core.report.hysteresis import Hysteresis
from bmd_rths_core.report.responses import FloorResponses
from bmd_rths_core.report.run_comparison import Comparison
from bmd_rths_core.report.timing import StepTiming
from bmd_rths_core.report.tracking import FloorTransfer, TableFrequencies, TrackingHistory

FigureData = (
    FloorResponses
    | TrackingHistory
    | TableFrequencies
    | FloorTransfer
    | InterfaceForces
    | Hysteresis
    | EnergyHistory
    | StepTiming
    | Comparison
)


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
    data : FigureData
        What it shows.
    caption : str
        What is to be seen.
    """

    data: FigureData
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
        The outcome, in words.
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
