"""Plot curves over time; long ones are thinned to what can be seen, so that a page stays small."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from bmd_rths_core.analysis.thinning import thinned

FloatArray = NDArray[np.float64]


def plot_history(axes: Axes, time: FloatArray, values: FloatArray, **look: Any) -> None:
    """Plot a curve over time, thinned where that hides no peak.

    Parameters
    ----------
    axes : Axes
        Where.
    time, values : ndarray, shape (N,)
        The curve; NaN makes a gap.
    **look : Any
        Colour, width, label.
    """
    axes.plot(*thinned(time, values), **look)


def between(time: FloatArray, values: FloatArray, window: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return the part of a curve in a window of time.

    Parameters
    ----------
    time, values : ndarray, shape (N,)
        The curve.
    window : tuple of float
        Begin and end [s].
    """
    inside = (time >= window[0]) & (time <= window[1])
    return time[inside], values[inside]
