"""Draw a figure of the paper and write it into files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from bmd_rths_core.paper_figures.catalogue import FigureData
from bmd_rths_core.paper_figures.margins import MarginFigure
from bmd_rths_core.paper_figures.table_response import TableResponse
from bmd_rths_core.plots.margins import draw_margins
from bmd_rths_core.plots.style import style, write
from bmd_rths_core.plots.table_response import draw_table_response
from bmd_rths_core.plots.time_history import draw_time_history


def draw(data: FigureData) -> Figure:
    """Draw a figure in the present style of matplotlib."""
    if isinstance(data, MarginFigure):
        return draw_margins(data)
    if isinstance(data, TableResponse):
        return draw_table_response(data)
    return draw_time_history(data)


def write_figure(data: FigureData, folder: Path, formats: Sequence[str]) -> list[Path]:
    """Draw a figure and write it into ``figure_<number>.<format>``.

    Parameters
    ----------
    data : MarginFigure, TableResponse or TimeHistory
        What it shows.
    folder : Path
        Where the files go; it has to exist.
    formats : sequence of str
        Some of `bmd_rths_core.plots.FORMATS`.

    Returns
    -------
    list of Path
        The files. The same data give the same bytes.
    """
    with style():
        return write(draw(data), folder / f"figure_{data.number}", formats)
