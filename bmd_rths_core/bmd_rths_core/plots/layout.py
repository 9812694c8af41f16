"""Place axes by millimetres: the same on page and sheet, and faster than measuring every label."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.gridspec import GridSpec

#: What a figure is drawn on: a page of its own, or a place on a sheet.
Canvas = Figure | SubFigure

#: Millimetres of an inch.
_INCH = 25.4

#: Room left and right of all axes [mm].
_LEFT, _RIGHT = 15.0, 3.0

#: Room for axis labels below all axes and between two rows that both have them [mm].
BOTTOM, LABELS = 10.0, 13.0

#: A legend of some axes just above them.
ABOVE: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.02), "borderaxespad": 0.0, "handlelength": 2.0}


def grid_in_mm(
    figure: Canvas,
    rows: int,
    columns: int = 1,
    top: float = 6.0,
    between: tuple[float, float] = (3.0, 18.0),
    height_ratios: Sequence[float] | None = None,
    width_ratios: Sequence[float] | None = None,
) -> GridSpec:
    """Return places for axes.

    Parameters
    ----------
    figure : Figure or SubFigure
        Where.
    rows, columns : int
        Number of places.
    top : float
        Room above all axes, for legend and titles [mm].
    between : tuple of float
        Room between rows and between columns [mm].
    height_ratios, width_ratios : sequence of float, optional
        Sizes of rows and columns relative to each other.
    """
    width, height = (_INCH * size / figure.dpi for size in (figure.bbox.width, figure.bbox.height))
    row = (height - top - BOTTOM - (rows - 1) * between[0]) / rows
    column = (width - _LEFT - _RIGHT - (columns - 1) * between[1]) / columns
    return figure.add_gridspec(
        rows,
        columns,
        left=_LEFT / width,
        right=1.0 - _RIGHT / width,
        bottom=BOTTOM / height,
        top=1.0 - top / height,
        hspace=between[0] / row,
        wspace=between[1] / column,
        height_ratios=height_ratios,
        width_ratios=width_ratios,
    )


def legend_on_top(figure: Canvas, axes: Axes, columns: int) -> None:
    """Put the legend of some axes above all, at the upper edge.

    Parameters
    ----------
    figure : Figure or SubFigure
        Where.
    axes : Axes
        They have every entry.
    columns : int
        Number of columns.
    """
    left = _LEFT / (_INCH * figure.bbox.width / figure.dpi)
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="upper left", bbox_to_anchor=(left, 1.0), ncol=columns, borderaxespad=0.0, handlelength=2.0
    )
