"""Plot curves over time; long ones are thinned to what can be seen, so that a page stays small."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Parts of a curve of which the smallest and the largest value are drawn.
_PARTS = 700


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


def thinned(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a curve with the smallest and the largest value of each of many short parts."""
    length = len(values) // _PARTS
    if length < 3 or not np.isfinite(values).all():
        return time, values
    whole = length * (len(values) // length)
    parts = values[:whole].reshape(-1, length)
    ends = np.sort(np.column_stack((parts.argmin(axis=1), parts.argmax(axis=1))), axis=1)
    kept = np.append((ends + length * np.arange(len(parts))[:, None]).ravel(), np.arange(whole, len(values)))
    return time[kept], values[kept]
