"""From times in seconds, as parameters have them, to time steps, as the loop counts them."""

from __future__ import annotations

import math
from fractions import Fraction

#: A time step that is no whole number of nanoseconds is a fraction of a second, 1/1024 s for example, up to this one.
_LARGEST_DENOMINATOR = 10**6


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


class StepStamps:
    """Message stamps of steps: the test time k Δt of step k in whole nanoseconds, rounded where Δt is none.

    Parameters
    ----------
    time_step : float
        Δt [s].
    """

    __slots__ = ("_denominator", "_numerator")

    def __init__(self, time_step: float) -> None:
        exact, whole = Fraction(time_step).limit_denominator(_LARGEST_DENOMINATOR) * 10**9, round(time_step * 1e9)
        if abs(time_step * 1e9 - whole) < 1e-6:
            exact = Fraction(whole)
        self._numerator, self._denominator = exact.as_integer_ratio()

    def of(self, step: int) -> int:
        """Return the stamp of a step [ns].

        Parameters
        ----------
        step : int
            Step index.
        """
        return (step * self._numerator + self._denominator // 2) // self._denominator

    def step(self, stamp: int) -> int | None:
        """Return the step of a stamp; None for one that is that of no step.

        Parameters
        ----------
        stamp : int
            [ns]. Where Δt is not in whole nanoseconds it may be rounded either way.
        """
        step = (stamp * self._denominator + self._numerator // 2) // self._numerator
        return step if abs(self.of(step) - stamp) <= (self._denominator > 1) else None

    def step_under_way(self, stamp: int) -> int:
        """Return the last step that has begun at a time.

        Parameters
        ----------
        stamp : int
            [ns].
        """
        return (stamp + (self._denominator > 1)) * self._denominator // self._numerator
