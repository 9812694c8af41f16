"""Linear-quadratic tracking of the numerical substructure, with an observer of the actuator and its unknown error."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_discrete_are

from bmd_rths_core.integration.runge_kutta import runge_kutta_4
from bmd_rths_core.vrths.problem import (
    DISPLACEMENT_NOISE,
    NOMINAL,
    RATE,
    TIME_STEP,
    actuator_model,
    numerical_building,
)
from bmd_rths_core.vrths.trackers import Asked
from bmd_rths_core.vrths.trim import Trim

FloatArray = NDArray[np.float64]


class LqgSettings(NamedTuple):
    """What the tracking weighs, and what the observer assumes.

    Parameters
    ----------
    command_weight : float
        Of what the command differs from a constant lead, relative to the error of the displacement [1].
    lead_steps : float
        How far the displacement runs ahead of the desired one, for the force that comes back late [steps].
    command_error : float
        White error of the command, root mean square [m].
    drift : float
        What the lasting error of the command changes by in a step, root mean square [m].
    ground_frequency : float
        Up to where the ground acceleration has its power: it is taken as a first-order process [Hz].
    """

    command_weight: float = 1e-3
    lead_steps: float = 1.0
    command_error: float = 2e-5
    drift: float = 2e-6
    ground_frequency: float = 2.0


#: Where the tracking begins from: gain and lag of the nominal actuator at low frequencies [1, s].
_GAIN, _LEAD = 1.0075, 0.024


class TrackingLqg:
    """u = −K [x̂, w, x_N, f, a_g], the same gains in all of p lanes.

    x̂ is the actuator as the observer sees it, w the lasting error of its command, x_N the numerical substructure and f
    the force that acts on it in this step. Only the measured displacement corrects the observer: the force tells of
    the stiffness of the specimen, which is another one in every plant, at least as much as of the motion.

    Parameters
    ----------
    case : int
        Building.
    settings : LqgSettings
        Weights and noise.
    trim : Trim, optional
        Adapts the command to the actuator.
    """

    def __init__(self, case: int, settings: LqgSettings, trim: Trim | None = None) -> None:
        model = actuator_model(NOMINAL)
        step = runge_kutta_4(model.a, model.b, TIME_STEP)
        phi, gamma = step.phi, step.gamma_0 + step.gamma_1
        self._transition = block_diag(phi, [[1.0]])
        self._transition[:-1, -1:] = gamma
        self._by_command = np.vstack((gamma, [[0.0]]))
        self._observed = np.append(model.displacement, 0.0)[None]
        self._kalman = self._observer(settings)
        self._gain = _tracking_gain(case, phi, gamma, model.force, model.displacement, settings)
        self._trim = trim
        self.reset()

    def reset(self) -> None:
        """Return to rest before step 0."""
        self._state: FloatArray | None = None
        self._force: FloatArray | float = 0.0
        if self._trim is not None:
            self._trim.reset()

    def step(self, asked: Asked) -> FloatArray:
        """Return the command of this step."""
        _, displacement, force = asked.measurement
        state = np.zeros((len(self._transition), len(displacement))) if self._state is None else self._state
        state = state + self._kalman * (displacement - self._observed @ state)
        known = np.empty((2, len(displacement)))
        known[0], known[1] = self._force, asked.ground_acceleration
        command = (self._gain @ np.vstack((state, asked.motion, known)))[0]
        self._state = self._transition @ state + self._by_command * command
        self._force = force
        return np.asarray(command) if self._trim is None else self._trim.applied(command, displacement)

    def _observer(self, settings: LqgSettings) -> FloatArray:
        a, b, c = self._transition, self._by_command, self._observed
        process = settings.command_error**2 * b @ b.T
        process[-1, -1] += settings.drift**2
        noise = np.array([[DISPLACEMENT_NOISE * RATE]])
        # In millimetres: the Riccati equation is then of numbers near one.
        prior = solve_discrete_are(a.T, 1e3 * c.T, process, 1e6 * noise)
        return np.asarray(1e3 * prior @ (1e3 * c.T) / (1e6 * (c @ prior @ c.T + noise)))


def _tracking_gain(
    case: int, phi: FloatArray, gamma: FloatArray, force: FloatArray, displacement: FloatArray, settings: LqgSettings
) -> FloatArray:
    """Return the gains of actuator, lasting error, numerical substructure, late force and ground acceleration."""
    a, b = numerical_building(case).motion()
    numerical = runge_kutta_4(a, b, TIME_STEP)
    stays = math.exp(-2.0 * math.pi * settings.ground_frequency * TIME_STEP)
    own, building = len(phi), slice(len(phi), len(phi) + len(a))
    size = own + len(a) + 2
    joint, by_command = np.zeros((size, size)), np.zeros((size, 1))
    joint[:own, :own], by_command[:own] = phi, gamma
    joint[building, building] = numerical.phi
    joint[building, -2] = numerical.gamma_0[:, 1] + numerical.gamma_1[:, 1]
    joint[building, -1] = numerical.gamma_0[:, 0] + stays * numerical.gamma_1[:, 0]
    joint[-2, :own], joint[-1, -1] = force, stays
    # What a constant lead would command is free; only what the command differs from it has a price.
    free = np.zeros((1, size))
    free[0, own], free[0, own + len(a) // 2] = 1.0 / _GAIN, _LEAD
    error = np.zeros((1, size))
    error[0, :own], error[0, own], error[0, own + len(a) // 2] = displacement, -1.0, -settings.lead_steps * TIME_STEP
    # Millimetres and kilonewtons, so that the Riccati equation is of numbers near one.
    units = np.ones(size)
    units[3], units[4], units[2], units[-2] = 1e3, 1e2, 1e-3, 1e-3
    units[building] = np.repeat((1e3, 1e2), len(a) // 2)
    scaled = units[:, None] * (joint + by_command @ free) / units
    driven, seen = units[:, None] * by_command, 1e3 * error / units
    weight = np.array([[1e6 * settings.command_weight]])
    cost = solve_discrete_are(scaled, driven, seen.T @ seen + 1e-12 * np.eye(size), weight)
    gain = np.linalg.solve(weight + driven.T @ cost @ driven, driven.T @ cost @ scaled) * units
    whole = free - gain
    return np.hstack((whole[:, :own], [[-1.0]], whole[:, own:]))


def fixed_lqg(case: int, lanes: int) -> TrackingLqg:
    """Return the tracking without adaptation."""
    return TrackingLqg(case, LqgSettings())


def adaptive_lqg(case: int, lanes: int) -> TrackingLqg:
    """Return the tracking whose command is trimmed; then the lasting error that is left is smaller."""
    return TrackingLqg(case, LqgSettings(drift=5e-7), Trim(lanes))
