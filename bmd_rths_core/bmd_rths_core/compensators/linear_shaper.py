"""A shaper that is a linear system."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]


class LinearShaper:
    """Turn the desired acceleration into the command by a linear system, which may take what the table measured.

    Parameters
    ----------
    system : DiscreteStateSpace
        Inputs and output as `Shaper.state_space` has them; one input, or two: desired and measured acceleration of the
        table.
    bridged : DiscreteStateSpace, optional
        In a step without measurement; required with two inputs.
    by_error : ndarray, shape (n,), optional
        What an applied command that is not the one asked for adds to the state, per m/s².
    floors : int
        Number of floors of the specimen.
    """

    def __init__(
        self,
        system: DiscreteStateSpace,
        bridged: DiscreteStateSpace | None = None,
        by_error: FloatArray | None = None,
        floors: int = 0,
    ) -> None:
        self._system, self._learns, self._floors, self._by_error = system, bridged is not None, floors, by_error
        self._measured_step = _packed(system)
        self._bridged_step = self._measured_step if bridged is None else _packed(bridged)
        self._size = len(system.a)
        self._stacked = np.zeros(self._size + system.b.shape[1])
        self.reset()

    def reset(self) -> None:
        """Return to rest before step 0."""
        self._stacked[:] = 0.0
        self._command = 0.0
        self._observed = True  # the table is at rest

    def step(self, desired_acceleration: float) -> float:
        """Return the command of this step."""
        stacked, size = self._stacked, self._size
        stacked[size] = desired_acceleration
        result = (self._measured_step if self._observed else self._bridged_step) @ stacked
        stacked[:size] = result[1:]
        self._observed = not self._learns
        self._command = float(result[0])
        return self._command

    def learn(self, measurement: TableMeasurement) -> None:
        """Keep the measured acceleration of the table for the next step."""
        if not self._learns:
            return
        if self._by_error is not None and math.isfinite(measurement.applied_command):
            self._stacked[: self._size] += self._by_error * (measurement.applied_command - self._command)
        self._observed = math.isfinite(measurement.table_acceleration)
        self._stacked[-1] = measurement.table_acceleration if self._observed else 0.0

    def state_space(self) -> DiscreteStateSpace:
        """Return the shaper as a linear system, every step measured."""
        a, b, c, d = self._system
        if not self._learns:
            return self._system
        others = self._floors + 3
        widened = (np.hstack((matrix, np.zeros((len(matrix), others)))) for matrix in (b, d))
        return DiscreteStateSpace(a, next(widened), c, next(widened))


def _packed(system: DiscreteStateSpace) -> FloatArray:
    return np.vstack((np.hstack((system.c, system.d)), np.hstack((system.a, system.b))))
