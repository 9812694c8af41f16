"""Stability of the loop of an interface control: how much heavier or lighter the real specimen may be than it is known.

Such a control has no one row of the loop that carries the shear: the share that is fed back is part of its design. What
the design does not know is the real specimen. So its masses are varied, with stiffness and damping kept, while the
control goes on with its models.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bmd_rths_core.compensators.protocol import LinearControl
from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_interface_control
from bmd_rths_core.loop.controlled_loop import controlled_loop
from bmd_rths_core.loop.linear_loop import ClosedLoop
from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, StabilityMargin, StableInterval

#: Masses are varied by this factor at a time, down to and up to those over and times the largest factor.
_STEP, _LARGEST = 1.05, 10.0
#: Factors at the end of the stability are told apart down to this.
_RESOLUTION = 1e-9


def loop_at_mass_ratio(config: Config, configured: float, ratio: float) -> ClosedLoop:
    """Return the loop of an interface control with a heavier or lighter specimen than it knows.

    Parameters
    ----------
    config : Config
        The whole configuration.
    configured : float
        Its mass ratio.
    ratio : float
        That with the real specimen, > 0 and < 1.

    Returns
    -------
    ClosedLoop
    """
    return controlled_loop(config, _factor(ratio, configured))


def controlled_margin(config: Config, configured: float, largest: float = LARGEST_MASS_RATIO) -> StabilityMargin:
    """Return the mass ratios of the real specimen for which the loop of an interface control is stable.

    Parameters
    ----------
    config : Config
        The whole configuration.
    configured : float
        Its mass ratio.
    largest : float
        Largest mass ratio to examine, between 0 and 1.

    Returns
    -------
    StabilityMargin
        Its one interval is that around the configured mass ratio; none where the loop is not stable as configured.
        Masses are examined in steps of 5 %, from a tenth to ten times what is known.
    """
    linear = _linear(config)

    def loop(factor: float) -> ClosedLoop:
        return controlled_loop(config, factor, linear)

    if loop(1.0).spectral_radius >= 1.0:
        return StabilityMargin(0.0, np.nan, ())
    lower, lower_frequency = _end(loop, 1.0 / _STEP, 1.0 / _LARGEST, config.run.time_step)
    highest = max(1.0, min(_LARGEST, _factor(largest, configured)))
    upper, upper_frequency = _end(loop, _STEP, highest, config.run.time_step)
    ends = (_ratio(lower, configured), _ratio(upper, configured))
    return StabilityMargin(ends[1], upper_frequency, (StableInterval(*ends, lower_frequency, upper_frequency),))


def _linear(config: Config) -> LinearControl | None:
    control = make_interface_control(config)
    return None if control is None else control.state_space()


def _end(loop: Callable[[float], ClosedLoop], step: float, last: float, time_step: float) -> tuple[float, float]:
    """Return the factor at which the loop leaves the stability, and how fast it oscillates there [rad/s].

    The frequency is NaN where the loop is stable up to the last factor.
    """
    stable, count = 1.0, int(np.ceil(np.log(last) / np.log(step) - 1e-9))
    for factor in [step**k for k in range(1, count)] + ([last] if count > 0 else []):
        if loop(factor).spectral_radius >= 1.0:
            break
        stable = factor
    else:
        return last, np.nan
    unstable = factor
    while abs(unstable / stable - 1.0) > _RESOLUTION:
        middle = np.sqrt(stable * unstable)
        if loop(middle).spectral_radius < 1.0:
            stable = middle
        else:
            unstable = middle
    values = np.linalg.eigvals(loop(unstable).transition)
    return stable, float(abs(np.angle(values[np.argmax(np.abs(values))])) / time_step)


def _factor(ratio: float, configured: float) -> float:
    return ratio / (1.0 - ratio) * (1.0 - configured) / configured


def _ratio(factor: float, configured: float) -> float:
    quotient = factor * configured / (1.0 - configured)
    return quotient / (1.0 + quotient)
