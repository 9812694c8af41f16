"""Stability of a loop with sub-steps: searched, because the shear enters it in every step of a period."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.loop.closed_loop import steps_of_a_period
from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, StabilityMargin, StableInterval
from bmd_rths_core.stability.discrete import configured_mass_ratio, opened, with_feedback_scale

FloatArray = NDArray[np.float64]

#: Lowest m_E/m_N that is examined, and the factor from one to the next.
_LOWEST, _STEP = 1e-3, 1.05
#: m_E/m_N at the end of the stability are told apart down to this, relatively.
_RESOLUTION = 1e-9


def substepped_margin(config: Config, largest: float = LARGEST_MASS_RATIO) -> StabilityMargin:
    """Return the allowable mass ratio of a loop with sub-steps.

    Parameters
    ----------
    config : Config
        The whole configuration, with sub-steps; its own mass ratio does not matter.
    largest : float
        Largest mass ratio to examine, between 0 and 1.

    Returns
    -------
    StabilityMargin
        As `discrete_margin` has it, from the eigenvalues over an integration step. m_E/m_N is examined from a
        thousandth on, in steps of 5 %: a stable or unstable interval that is narrower may be missed. Critical
        frequencies are angles over N Δt, at most π/(N Δt).
    """
    period = _Period(config)
    highest = largest / (1.0 - largest)
    count = int(np.ceil(np.log(highest / _LOWEST) / np.log(_STEP)))
    quotients = np.append(_LOWEST * _STEP ** np.arange(count), highest).tolist()
    stable = [period.is_stable(quotient) for quotient in quotients]
    intervals: list[StableInterval] = []
    lower, lower_frequency = 0.0, np.nan
    for i in range(1, len(quotients)):
        if stable[i] == stable[i - 1]:
            continue
        end, frequency = _end(period, quotients[i - 1], quotients[i], stable[i - 1])
        if stable[i]:
            lower, lower_frequency = end, frequency
        else:
            intervals.append(StableInterval(lower, end, lower_frequency, frequency))
    if stable[-1]:
        intervals.append(StableInterval(lower, largest, lower_frequency, np.nan))
    if not stable[0]:
        return StabilityMargin(0.0, np.nan, tuple(intervals))
    return StabilityMargin(intervals[0].upper, intervals[0].upper_frequency, tuple(intervals))


class _Period:
    """The steps from one target to the next, by the share of the shear that is fed back."""

    def __init__(self, config: Config) -> None:
        self._steps = [opened(config, loop) for loop in steps_of_a_period(config)]
        self.duration = config.integration_step
        whole = configured_mass_ratio(with_feedback_scale(config, 1.0))
        self._quotient = whole / (1.0 - whole)

    def eigenvalues(self, quotient: float) -> NDArray[np.complex128]:
        """Return those from target to target, for an m_E/m_N."""
        product = np.eye(len(self._steps[0][0]))
        for open_loop, shear in self._steps:
            closed = open_loop.copy()
            closed[0] += quotient / self._quotient * shear
            product = closed @ product
        return np.asarray(np.linalg.eigvals(product), dtype=complex)

    def is_stable(self, quotient: float) -> bool:
        """Tell whether the loop is."""
        return bool(np.abs(self.eigenvalues(quotient)).max() < 1.0)


def _end(period: _Period, below: float, above: float, stable_below: bool) -> tuple[float, float]:
    """Return the mass ratio between two m_E/m_N at which the stability changes, and how fast it oscillates [rad/s]."""
    while above / below - 1.0 > _RESOLUTION:
        middle = float(np.sqrt(below * above))
        if period.is_stable(middle) == stable_below:
            below = middle
        else:
            above = middle
    values = period.eigenvalues(above)
    angle = float(abs(np.angle(values[np.argmax(np.abs(values))])))
    return below / (1.0 + below), angle / period.duration
