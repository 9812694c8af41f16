"""The control plants of the benchmark problem: servo valve, actuator and experimental substructure, with sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.runge_kutta import runge_kutta_4, stage_responses
from bmd_rths_core.vrths.problem import (
    DISPLACEMENT_NOISE,
    FORCE_LIMIT,
    FORCE_NOISE,
    RANGE,
    RATE,
    RESOLUTION,
    TIME_STEP,
    PlantParameters,
    actuator_model,
)

FloatArray = NDArray[np.float64]

#: Steps of noise that are drawn at once.
_DRAWN = 4096


class ActuatorMeasurement(NamedTuple):
    """What the sensors of every lane say at the end of a step.

    Parameters
    ----------
    step : int
        Step index of the command that was held until now.
    displacement : ndarray, shape (p,)
        Of the actuator [m].
    force : ndarray, shape (p,)
        Of the experimental substructure, relative to the ground [N].
    """

    step: int
    displacement: FloatArray
    force: FloatArray


class Actuator:
    """Move the plants of p lanes by the Runge-Kutta method of fourth order; commands are held over a step.

    Parameters
    ----------
    plants : sequence of PlantParameters
        One for each lane.
    seeds : sequence of int
        Of the noise of each lane.

    Attributes
    ----------
    true_displacement, true_force : ndarray, shape (p,)
        Without noise, at the end of the last step [m, N].
    limited : ndarray of bool, shape (p,)
        The force was at its limit since the last `connect`.
    """

    def __init__(self, plants: Sequence[PlantParameters], seeds: Sequence[int]) -> None:
        rows, forces, states = [], [], []
        for plant in plants:
            model = actuator_model(plant)
            step = runge_kutta_4(model.a, model.b, TIME_STEP)
            at_stages = np.einsum("i,sij->sj", model.force, step.stages)
            rows.append(np.vstack((np.hstack((step.phi, step.gamma_0 + step.gamma_1)), at_stages)))
            stages, after = stage_responses(model.a, model.by_limited_force, TIME_STEP)
            forces.append(np.einsum("i,sij->sj", model.force, stages))
            states.append(after)
        self._step = np.stack(rows, axis=-1)
        self._forces_by_excess, self._state_by_excess = np.stack(forces, axis=-1), np.stack(states, axis=-1)
        self._seeds = seeds
        self.connect()

    def connect(self) -> None:
        """Be at rest before step 0, with the noise from its seeds."""
        lanes = self._step.shape[-1]
        self._stacked = np.zeros((6, lanes))
        self._random = [np.random.default_rng(seed) for seed in self._seeds]
        self._drawn = np.empty((0, 2, lanes))
        self._used = 0
        self.true_displacement = self.true_force = np.zeros(lanes)
        self.limited = np.zeros(lanes, dtype=bool)

    def move(self, step: int, command: FloatArray) -> ActuatorMeasurement:
        """Apply a command for one step and return the sensors at its end.

        Parameters
        ----------
        step : int
            Step index.
        command : ndarray, shape (p,)
            Displacement that is commanded [m].
        """
        stacked = self._stacked
        stacked[5] = command
        result = np.einsum("ijl,jl->il", self._step, stacked)
        if np.abs(result[5:]).max() > FORCE_LIMIT:
            result[:5] += self._by_excess(result[5:])
        stacked[:5] = result[:5]
        self.true_displacement = result[3]
        self.true_force = np.clip(result[2], -FORCE_LIMIT, FORCE_LIMIT)
        return self.read(step)

    def read(self, step: int) -> ActuatorMeasurement:
        """Return what the sensors say now, with new noise.

        Parameters
        ----------
        step : int
            Step index.
        """
        if self._used == len(self._drawn):
            drawn = [random.standard_normal((_DRAWN, 2)) for random in self._random]
            deviations = np.sqrt(np.array([DISPLACEMENT_NOISE, FORCE_NOISE]) * RATE)
            self._drawn, self._used = np.stack(drawn, axis=-1) * deviations[:, None], 0
        of_displacement, of_force = self._drawn[self._used]
        self._used += 1
        sensed = np.clip(self.true_displacement + of_displacement, -RANGE, RANGE)
        return ActuatorMeasurement(step, np.rint(sensed / RESOLUTION) * RESOLUTION, self.true_force + of_force)

    def _by_excess(self, forces: FloatArray) -> FloatArray:
        """Return what the states after a step are less the linear ones, which have these forces at the four stages."""
        excess = np.zeros_like(forces)
        for i in range(len(forces)):
            force = forces[i] + np.einsum("jl,jl->l", self._forces_by_excess[i], excess)
            excess[i] = force - np.clip(force, -FORCE_LIMIT, FORCE_LIMIT)
        self.limited |= excess.any(axis=0)
        return np.asarray(np.einsum("ijl,jl->il", self._state_by_excess, excess))
