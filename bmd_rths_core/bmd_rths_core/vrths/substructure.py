"""The numerical substructure of the benchmark problem, as the conductor drives it: out goes a displacement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.runge_kutta import runge_kutta_4
from bmd_rths_core.vrths.actuator import ActuatorMeasurement
from bmd_rths_core.vrths.problem import TIME_STEP, Building

FloatArray = NDArray[np.float64]


class InterfaceDisplacement(NamedTuple):
    """What one step says about the interface, in every lane.

    Parameters
    ----------
    desired_acceleration : ndarray, shape (p,)
        Absolute acceleration of the first floor [m/s²].
    required_force : ndarray, shape (p,)
        Force of the experimental substructure that this response takes as given [N].
    command : ndarray, shape (p,)
        Displacement of the first floor relative to the ground, which the actuator has to follow [m].
    """

    desired_acceleration: FloatArray
    required_force: FloatArray
    command: FloatArray


class DisplacementSubstructure:
    """Integrate the numerical substructures of p lanes, one lane a plant, by the Runge-Kutta method of fourth order.

    The ground acceleration is linear between the steps, the force is held over each.

    Parameters
    ----------
    buildings : sequence of Building
        One for each lane, n floors.

    Attributes
    ----------
    state : ndarray, shape (2n, p)
        Displacements and velocities relative to the ground at this step [m, m/s].
    """

    takes_feedback = True

    def __init__(self, buildings: Sequence[Building]) -> None:
        self._floors = len(buildings[0].mass)
        steps = []
        accelerations = []
        for building in buildings:
            a, b = building.motion()
            step = runge_kutta_4(a, b, TIME_STEP)
            force = step.gamma_0[:, 1:] + step.gamma_1[:, 1:]
            steps.append(np.hstack((step.phi, step.gamma_0[:, :1], step.gamma_1[:, :1], force)))
            accelerations.append(np.append(a[self._floors], b[self._floors] + (1.0, 0.0)))
        self._step = np.stack(steps, axis=-1)
        self._acceleration = np.stack(accelerations, axis=-1)
        self._stacked = np.zeros((2 * self._floors + 3, len(buildings)))
        self.reset()

    @property
    def displacements(self) -> FloatArray:
        """Of the floors, shape (n, p) [m]."""
        return self.state[: self._floors]

    def reset(self) -> None:
        """Return to rest before step 0."""
        self._stacked[:] = 0.0
        self.state = np.zeros((2 * self._floors, self._stacked.shape[1]))
        self._started = False

    def step(self, ground_acceleration: float, feedback_force: FloatArray | float) -> InterfaceDisplacement:
        """Advance to the next step.

        Parameters
        ----------
        ground_acceleration : float
            a_g of this step [m/s²].
        feedback_force : ndarray, shape (p,), or 0
            Force that acts since the last step [N].
        """
        stacked, n = self._stacked, len(self.state)
        if self._started:
            stacked[n + 1], stacked[n + 2] = ground_acceleration, feedback_force
            self.state = np.einsum("ijl,jl->il", self._step, stacked)
        self._started = True
        stacked[:n], stacked[n], stacked[n + 1] = self.state, ground_acceleration, feedback_force
        desired = np.einsum("jl,jl->l", self._acceleration, stacked[: n + 2])
        return InterfaceDisplacement(desired, stacked[n + 1].copy(), self.state[0])

    def learn(self, measurement: ActuatorMeasurement) -> None:
        """Do without: the force that is fed back is all it takes."""
