"""Displacement commands for tables that are displacement-controlled, without drift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import zero_order_hold
from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.trips import Action, Trip

FloatArray = NDArray[np.float64]


class TableMotion(NamedTuple):
    """What a displacement-controlled table is asked to do at the end of a step.

    Parameters
    ----------
    velocity : float
        [m/s].
    displacement : float
        [m].
    """

    velocity: float
    displacement: float


class DisplacementCommand:
    """Integrate an acceleration command twice, behind a high-pass.

    Parameters
    ----------
    config : SafetyConfig
        With the corner frequency.
    time_step : float
        Δt [s].

    Notes
    -----
    A Butterworth high-pass of third order, H(s) = s³ / (s³ + 2 ω s² + 2 ω² s + ω³), so that displacement over
    acceleration is s / (s³ + 2 ω s² + 2 ω² s + ω³): a constant error of the acceleration leaves no displacement, and an
    acceleration of zero leads to rest at zero. At frequency Ω the displacement leads by about 2 ω / Ω rad. The discrete
    form is exact for commands that are held over the step.
    """

    def __init__(self, config: SafetyConfig, time_step: float) -> None:
        corner = config.high_pass_frequency
        a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(corner**3), -2.0 * corner**2, -2.0 * corner]])
        phi, gamma = zero_order_hold(a, np.array([[0.0], [0.0], [1.0]]), time_step)
        self._rows = [(*row, input_) for row, input_ in zip(phi.tolist(), gamma[:, 0].tolist(), strict=True)]
        self.reset()

    def reset(self) -> None:
        """Return to rest at zero displacement."""
        self._state = (0.0, 0.0, 0.0)

    def step(self, acceleration: float) -> TableMotion:
        """Return the motion at the end of the step.

        Parameters
        ----------
        acceleration : float
            Acceleration command, held over the step [m/s²].

        Returns
        -------
        TableMotion
        """
        # The state is the integral of the displacement, the displacement and the velocity.
        x, y, z = self._state
        (a, b, c, d), (e, f, g, h), (i, j, k, m) = self._rows
        self._state = (
            a * x + b * y + c * z + d * acceleration,
            e * x + f * y + g * z + h * acceleration,
            i * x + j * y + k * z + m * acceleration,
        )
        return TableMotion(self._state[2], self._state[1])


def table_motion(acceleration: FloatArray, config: SafetyConfig, time_step: float) -> tuple[FloatArray, FloatArray]:
    """Return the displacement commands of a whole acceleration history.

    Parameters
    ----------
    acceleration : ndarray, shape (N,)
        Acceleration commands [m/s²].
    config : SafetyConfig
        With the corner frequency.
    time_step : float
        Δt [s].

    Returns
    -------
    velocity : ndarray, shape (N,)
        At the ends of the steps [m/s].
    displacement : ndarray, shape (N,)
        At the ends of the steps [m].
    """
    command = DisplacementCommand(config, time_step)
    motions = np.array([command.step(value) for value in acceleration.tolist()]).reshape(-1, 2)
    return motions[:, 0], motions[:, 1]


def stroke_trips(acceleration: FloatArray, config: SafetyConfig, time_step: float) -> list[Trip]:
    """Return the limits of displacement and velocity that the motion of a displacement-controlled table passes.

    Parameters
    ----------
    acceleration : ndarray, shape (N,)
        Acceleration commands [m/s²].
    config : SafetyConfig
        With the limits and the corner frequency.
    time_step : float
        Δt [s].

    Returns
    -------
    list of Trip
        One for each limit that is passed, at the first step where it is; none for a limit whose action lets the test
        go on.
    """
    velocity, displacement = table_motion(acceleration, config, time_step)
    trips = []
    for limit, unit, values in (("displacement", "m", displacement), ("velocity", "m/s", velocity)):
        allowed, action = getattr(config, f"{limit}_limit"), config.action(limit)
        passed = np.flatnonzero(np.abs(values) > allowed)
        if passed.size and action > Action.INDICATE:
            step = int(passed[0])
            quantity = f"{limit} a displacement-controlled table is asked for"
            trips.append(Trip(f"safety.{limit}_limit", unit, quantity, float(values[step]), allowed, step, action))
    return trips
