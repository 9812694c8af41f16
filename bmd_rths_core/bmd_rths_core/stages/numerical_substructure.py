"""Numerical substructure: the lower part of the building, integrated exactly for piecewise-linear loads (Eq. 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import DiscreteStateSpace, first_order_hold
from bmd_rths_core.integration.substeps import MOST_SUBSTEPS
from bmd_rths_core.parameters import parameter
from bmd_rths_core.physical_bounds import DAMPING, MASS, STIFFNESS
from bmd_rths_core.structure.config import BuildingConfig
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.table.controller import TableMeasurement


@dataclass(frozen=True)
class NumericalSubstructureConfig(BuildingConfig):
    """Stories below the interface, from the ground up; the interface is the topmost of these floors."""

    SECTION: ClassVar[str] = "numerical_substructure"

    masses: tuple[float, ...] = parameter(
        (8000.0,),
        description="Floor masses from the ground up; the last is the interface",
        unit="kg",
        source="Chen et al. 2020, simplified BMD: m_N = 8 kN s2/m",
        **MASS,
    )
    stiffnesses: tuple[float, ...] = parameter(
        (70823424.8,),
        description="Story stiffnesses from the ground up",
        unit="N/m",
        source="Chen et al. 2020, simplified BMD: m_N w_N^2 with w_N = 94.09 rad/s",
        **STIFFNESS,
    )
    damping_coefficients: tuple[float, ...] = parameter(
        (25140.848,),
        description="Story damping coefficients from the ground up",
        unit="N s/m",
        source="Chen et al. 2020, simplified BMD: 2 z_N w_N m_N with z_N = 1.67 %",
        **DAMPING,
    )
    substeps: int = parameter(
        1,
        description="Steps of the loop that one integration of the substructure may take; above 1 the commands between "
        "are predicted and then corrected, and the integration has run.time_step times as many seconds",
        unit="1",
        source="Nakashima and Masaoka 1999; Schellenberg et al. 2009; docs/decisions/0020",
        lower=1,
        upper=MOST_SUBSTEPS,
    )


class NumericalResponse(NamedTuple):
    """What one integration step says about the interface.

    Parameters
    ----------
    desired_acceleration : float
        Absolute acceleration of the interface ü + ü_g, to be reproduced by the table [m/s²].
    required_force : float
        m (ü + ü_g) + c u̇ + k u at the interface: the shear that balances this response (Eqs. 4 and 11) [N].
    """

    desired_acceleration: float
    required_force: float

    @property
    def command(self) -> float:
        """What the command shaper gets: the desired acceleration [m/s²]."""
        return self.desired_acceleration


class NumericalSubstructure:
    """Integrate the numerical substructure.

    The ground acceleration and the interface shear are taken as linear between the steps; for such loads the solution
    at the steps is exact, for any number of stories and any time step (the method of Nigam and Jennings 1969, in
    state space).

    Parameters
    ----------
    building : NumericalSubstructureConfig or LinearBuilding
        The substructure; any linear one.
    time_step : float
        Δt [s].

    Attributes
    ----------
    displacements, velocities : ndarray, shape (n,)
        Motion of the floors relative to the ground at the last step [m, m/s].
    """

    takes_feedback = True

    def __init__(self, building: NumericalSubstructureConfig | LinearBuilding, time_step: float) -> None:
        if isinstance(building, NumericalSubstructureConfig):
            building = building.building()
        n = building.stories
        a, base_input, _ = building.relative_motion()
        shear_input = np.zeros((2 * n, 1))
        shear_input[n:, 0] = building.interface_shares() / building.interface_mass
        phi, gamma_0, gamma_1 = first_order_hold(a, np.hstack((base_input, shear_input)), time_step)
        # One product a step: [x, a_g, f] of the last step and [a_g, f] of this one give the state of this one.
        self._transition = np.hstack((phi, gamma_0, gamma_1))
        self._stacked = np.zeros(2 * n + 4)
        self._state = np.zeros(2 * n)
        self.displacements, self.velocities = self._state[:n], self._state[n:]
        self._interface_mass = building.interface_mass
        self._restoring = building.interface_restoring()
        self._started = False

    def reset(self) -> None:
        """Return to rest before step 0."""
        self._stacked[:] = 0.0
        self._state[:] = 0.0
        self._started = False

    def step(self, ground_acceleration: float, feedback_force: float) -> NumericalResponse:
        """Advance to the next step.

        Parameters
        ----------
        ground_acceleration : float
            a_g of this step [m/s²].
        feedback_force : float
            Interface shear fed back at the last step [N].

        Returns
        -------
        NumericalResponse
            Interface response at this step. The first call is step 0, at rest.
        """
        stacked, state = self._stacked, self._state
        n = len(state)
        stacked[n + 2] = ground_acceleration
        stacked[n + 3] = feedback_force
        if self._started:
            np.dot(self._transition, stacked, out=state)
        self._started = True
        stacked[:n] = state
        stacked[n] = ground_acceleration
        stacked[n + 1] = feedback_force
        restoring = float(self._restoring.dot(state))
        acceleration = (feedback_force - restoring) / self._interface_mass
        return NumericalResponse(acceleration, self._interface_mass * acceleration + restoring)

    def correct(self, force: float) -> None:
        """Add to the shear at the last target what was not known when it was computed."""
        stacked, state = self._stacked, self._state
        n = len(state)
        state += force * self._transition[:, n + 3]
        stacked[:n] = state
        stacked[n + 1] += force

    def correction(self) -> NDArray[np.float64]:
        """Return what `correct` changes per newton."""
        motion = self._transition[:, len(self._state) + 3]
        return np.concatenate(((-float(self._restoring.dot(motion)) / self._interface_mass,), motion))

    def learn(self, measurement: TableMeasurement) -> None:
        """Do without: the shear that is fed back is all it takes."""

    def state_space(self) -> DiscreteStateSpace:
        """Return the stage as a linear system.

        Returns
        -------
        DiscreteStateSpace
            Inputs a_g [m/s²] and shear fed back [N]; outputs desired acceleration [m/s²], required force [N] and n
            displacements [m]. The state is the motion at this step but for what the inputs of this step add. It begins
            with `start` times the first ground acceleration, or from zero when that is zero.
        """
        n, m = len(self._state), self._interface_mass
        phi, past, now = self._transition[:, :n], self._transition[:, n : n + 2], self._transition[:, n + 2 :]
        # Desired acceleration (f − r x) / m, required force, which is f, and displacements, for the motion x.
        of_motion = np.vstack((-self._restoring / m, np.zeros(n), np.eye(n // 2, n)))
        of_force = np.zeros((len(of_motion), 2))
        of_force[:2, 1] = 1.0 / m, 1.0
        return DiscreteStateSpace(a=phi, b=phi @ now + past, c=of_motion, d=of_motion @ now + of_force)

    @property
    def start(self) -> NDArray[np.float64]:
        """State of `state_space` that is at rest at step 0 under a ground acceleration of 1 m/s², shape (2n,).

        `step` has no interval before step 0 over which the first ground acceleration could act.
        """
        return -self._transition[:, len(self._state) + 2]
