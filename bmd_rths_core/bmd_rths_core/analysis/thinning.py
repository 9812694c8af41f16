"""Thin a long curve to what can be seen of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Parts of a curve of which the smallest and the largest value are kept.
PARTS = 700


def thinned(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a curve with the smallest and the largest value of each of many short parts.

    Parameters
    ----------
    time, values : ndarray, shape (N,)
        The curve; one with a NaN is returned as it is.
    """
    length = len(values) // PARTS
    if length < 3 or not np.isfinite(values).all():
        return time, values
    whole = length * (len(values) // length)
    parts = values[:whole].reshape(-1, length)
    ends = np.sort(np.column_stack((parts.argmin(axis=1), parts.argmax(axis=1))), axis=1)
    kept = np.append((ends + length * np.arange(len(parts))[:, None]).ravel(), np.arange(whole, len(values)))
    return time[kept], values[kept]
