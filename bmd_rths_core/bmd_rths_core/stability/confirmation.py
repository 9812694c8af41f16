"""Confirmation of a margin in the time domain: what the loop does after a shock, just below the margin and above it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bmd_rths_core.config import Config
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.linear_loop import ClosedLoop
from bmd_rths_core.stability.continuous import StabilityMargin
from bmd_rths_core.stability.controlled import loop_at_mass_ratio
from bmd_rths_core.stability.discrete import configured_mass_ratio, with_mass_ratio

#: Parts of the margin at which the loop is simulated.
BELOW, ABOVE = 0.99, 1.01
#: Steps whose largest response is one point of the envelope; longer than a period of the critical oscillation.
_WINDOW = 512
#: Points of the envelope, half of them for what dies out before the critical oscillation is alone: 1.5 hours at 200 Hz.
_WINDOWS = 2048


class Confirmation(NamedTuple):
    """Growth of the free response near an allowable mass ratio.

    Parameters
    ----------
    growth_below, growth_above : float
        Growth per step at 0.99 and 1.01 of the margin; NaN where there is nothing to simulate.
    confirmed : bool or None
        The response decays below the margin and grows above it; None when there is no stable mass ratio.
    """

    growth_below: float
    growth_above: float
    confirmed: bool | None


def confirm(config: Config, margin: StabilityMargin) -> Confirmation:
    """Simulate the loop of a configuration at 0.99 and 1.01 of its allowable mass ratio.

    Parameters
    ----------
    config : Config
        The whole configuration; its own mass ratio does not matter.
    margin : StabilityMargin
        From `discrete.discrete_margin`. When its search ended before the stability, only the decay is confirmed.

    Returns
    -------
    Confirmation
    """
    ratio = margin.allowable_mass_ratio
    if ratio == 0.0:
        return Confirmation(np.nan, np.nan, None)
    below = free_growth(_loop(config, BELOW * ratio))
    if np.isnan(margin.critical_frequency):
        return Confirmation(below, np.nan, below < 1.0)
    above = free_growth(_loop(config, ABOVE * ratio))
    return Confirmation(below, above, below < 1.0 < above)


def _loop(config: Config, ratio: float) -> ClosedLoop:
    """Return the loop at another mass ratio: of the numerical substructure, or of the specimen under a control."""
    if config.compensator.control is None:
        return closed_loop(with_mass_ratio(config, ratio))
    return loop_at_mass_ratio(config, configured_mass_ratio(config), ratio)


def free_growth(loop: ClosedLoop) -> float:
    """Return the growth of the shear fed back, per step, long after an impulse of the ground.

    Parameters
    ----------
    loop : ClosedLoop
        The loop.

    Returns
    -------
    float
        Mean factor by which the envelope is multiplied in a step of the loop, over the second half of a million of its
        transitions.

    Notes
    -----
    Every step is simulated, a window of them in one product: the shear of step j of a window is a row of Aʲ times the
    state at its beginning. No eigenvalue is used.
    """
    a, impulse = loop.transition, np.delete(loop.system.b[:, 0], loop.integrators)
    rows = [np.eye(1, len(a))[0]]
    for _ in range(_WINDOW - 1):
        rows.append(rows[-1] @ a)
    shears, window = np.array(rows), np.linalg.matrix_power(a, _WINDOW)
    state, growth = impulse / np.linalg.norm(impulse), 0.0
    state = state / np.abs(shears @ state).max()
    for k in range(_WINDOWS):
        state = window @ state
        envelope = np.abs(shears @ state).max()
        state = state / envelope
        if k >= _WINDOWS // 2:
            growth += float(np.log(envelope))
    return float(np.exp(growth / (loop.substeps * _WINDOW * (_WINDOWS - _WINDOWS // 2))))
