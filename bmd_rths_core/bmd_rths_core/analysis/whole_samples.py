"""Samples of a record made ready for analyses that need every one of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def filled(values: FloatArray) -> FloatArray:
    """Return a signal with its gaps bridged by straight lines; zero where nothing is known at all.

    Parameters
    ----------
    values : ndarray, shape (N,)
        NaN where nothing was recorded.
    """
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(len(values))
    steps = np.arange(len(values))
    return np.interp(steps, steps[known], values[known])


def strong_motion(ground_acceleration: FloatArray, time_step: float) -> tuple[float, float]:
    """Return begin and end of the strong motion [s]: from 5 % to 95 % of the Arias intensity.

    Parameters
    ----------
    ground_acceleration : ndarray, shape (N,)
        a_g of what was run [m/s²]; NaN counts as zero.
    time_step : float
        Δt [s].

    Returns
    -------
    tuple of float
        The whole when the ground was at rest throughout.
    """
    end = max(len(ground_acceleration) - 1, 0) * time_step
    power = np.cumsum(np.nan_to_num(ground_acceleration) ** 2)
    if len(power) < 2 or power[-1] == 0.0:
        return 0.0, end
    first, last = np.searchsorted(power, [0.05 * power[-1], 0.95 * power[-1]])
    return float(first) * time_step, max(float(last), float(first) + 1.0) * time_step
