"""Draw a figure into an SVG file."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.figure import Figure

from bmd_rths_core.plots.layout import Canvas
from bmd_rths_core.plots.style import DOUBLE_COLUMN, style, svg_of

#: Resolution of curves that are drawn as pixels [dots per inch].
_RESOLUTION = 200


def svg(draw: Callable[[Canvas], None], height: float) -> bytes:
    """Draw a figure two columns of a journal wide.

    Parameters
    ----------
    draw : callable
        Draws on an empty figure.
    height : float
        Height of the figure [mm].

    Returns
    -------
    bytes
        The file; the same drawing gives the same bytes.
    """
    with style():
        figure = Figure(figsize=(DOUBLE_COLUMN / 25.4, height / 25.4))
        draw(figure)
        return svg_of(figure, _RESOLUTION)
