"""From times in seconds, as parameters have them, to time steps, as the loop counts them."""

from __future__ import annotations

import math


def exact_steps(duration: float, time_step: float) -> float:
    """Return a duration in time steps, which need not be whole.

    Parameters
    ----------
    duration, time_step : float
        [s].

    Notes
    -----
    Rounded to 12 significant digits. Duration and time step are decimal numbers that binary ones only approach, so the
    last digits of their quotient are noise: 0.015 s are exactly 3 steps of 0.005 s, and not 3 − 4e-16.
    """
    return float(f"{duration / time_step:.12g}")


def most_steps(duration: float, time_step: float) -> int:
    """Return the most whole steps that are not longer than a duration.

    Parameters
    ----------
    duration, time_step : float
        [s].
    """
    return math.floor(exact_steps(duration, time_step))
