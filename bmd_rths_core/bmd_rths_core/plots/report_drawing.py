"""Any figure of a report: as SVG for a page, or in a place on a sheet of paper."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from typing import Any

from matplotlib.figure import Figure, SubFigure

from bmd_rths_core.plots.report_responses import draw_comparison, draw_responses, draw_transfer
from bmd_rths_core.plots.report_structure import STORIES_IN_A_ROW, draw_energy, draw_hysteresis
from bmd_rths_core.plots.report_table import draw_forces, draw_frequencies, draw_timing, draw_tracking
from bmd_rths_core.plots.style import DOUBLE_COLUMN, style
from bmd_rths_core.report.document import FigureData
from bmd_rths_core.report.energy import EnergyHistory
from bmd_rths_core.report.forces import InterfaceForces
from bmd_rths_core.report.hysteresis import Hysteresis
from bmd_rths_core.report.responses import FloorResponses
from bmd_rths_core.report.run_comparison import Comparison
from bmd_rths_core.report.timing import StepTiming
from bmd_rths_core.report.tracking import FloorTransfer, TableFrequencies, TrackingHistory

#: Resolution of curves of which every point is drawn [dots per inch].
_RESOLUTION = 200

_DRAW: dict[type, Callable[[Figure | SubFigure, Any], None]] = {
    FloorResponses: draw_responses,
    Comparison: draw_comparison,
    FloorTransfer: draw_transfer,
    TrackingHistory: draw_tracking,
    TableFrequencies: draw_frequencies,
    InterfaceForces: draw_forces,
    StepTiming: draw_timing,
    Hysteresis: draw_hysteresis,
    EnergyHistory: draw_energy,
}


def height_of(data: FigureData) -> float:
    """Return the height a figure needs [mm].

    Parameters
    ----------
    data : FigureData
        What it shows.
    """
    if isinstance(data, FloorResponses):
        return min(20.0 + 32.0 * len(data.floors), 250.0)
    if isinstance(data, FloorTransfer):
        return min(20.0 + 32.0 * len(data.names), 250.0)
    if isinstance(data, Hysteresis):
        return min(58.0 * -(-len(data.stories) // STORIES_IN_A_ROW), 250.0)
    if isinstance(data, InterfaceForces):
        return 150.0
    return 125.0 if isinstance(data, TrackingHistory) else 105.0


def draw(figure: Figure | SubFigure, data: FigureData) -> None:
    """Draw a figure in the present style of matplotlib.

    Parameters
    ----------
    figure : Figure or SubFigure
        Empty.
    data : FigureData
        What it shows.
    """
    _DRAW[type(data)](figure, data)


def svg_of(data: FigureData) -> bytes:
    """Return a figure as an SVG file, two columns of a journal wide.

    Parameters
    ----------
    data : FigureData
        What it shows.

    Returns
    -------
    bytes
        The same data give the same bytes.
    """
    with style():
        figure = Figure(figsize=(DOUBLE_COLUMN / 25.4, height_of(data) / 25.4))
        draw(figure, data)
        file = BytesIO()
        figure.savefig(file, format="svg", dpi=_RESOLUTION, metadata={"Date": None})
    return file.getvalue()
