"""The virtual building of MPIC: numerical substructure and model of the specimen, integrated as one system."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import first_order_hold, zero_order_hold
from bmd_rths_core.structure.linear_building import LinearBuilding

FloatArray = NDArray[np.float64]


class VirtualBuilding(NamedTuple):
    """x[k+1] = Φ x[k] + Γ₀ a_g[k] + Γ₁ a_g[k+1] with x = [x_N, x_v].

    Parameters
    ----------
    transition : ndarray, shape (m, m)
        Φ. x_N are displacements and velocities of the numerical floors relative to the ground, x_v those of the floors
        of the specimen relative to the interface.
    ground_before, ground_now : ndarray, shape (m, 1)
        Γ₀ and Γ₁, exact for a ground acceleration that is linear over the step.
    unmodelled : ndarray, shape (m, n)
        What an unmodelled acceleration of each floor of the specimen, held over the step, adds to the state.
    force : ndarray, shape (m,)
        Row of the interface force that acts on the numerical substructure, −s mᵀ C_E x_v [N].
    acceleration : ndarray, shape (m,)
        Row of the absolute acceleration of the interface, (f − r x_N) / m [m/s²].
    floors : ndarray, shape (n, m)
        Rows of the absolute accelerations of the floors of the specimen [m/s²].
    """

    transition: FloatArray
    ground_before: FloatArray
    ground_now: FloatArray
    unmodelled: FloatArray
    force: FloatArray
    acceleration: FloatArray
    floors: FloatArray

    @property
    def numerical_stories(self) -> int:
        """Number of floors of the numerical substructure."""
        return len(self.force) // 2 - len(self.floors)

    @property
    def interface(self) -> tuple[int, int]:
        """Indices of displacement and velocity of the interface relative to the ground."""
        stories = self.numerical_stories
        return stories - 1, 2 * stories - 1


def virtual_building(
    numerical: LinearBuilding, specimen: LinearBuilding, feedback_scale: float, time_step: float
) -> VirtualBuilding:
    """Couple numerical substructure and model of the specimen, and discretise both together.

    Parameters
    ----------
    numerical, specimen : LinearBuilding
        Below and above the interface.
    feedback_scale : float
        Share s of the interface shear that acts on the numerical substructure.
    time_step : float
        Δt [s].

    Returns
    -------
    VirtualBuilding
    """
    lower, upper = 2 * numerical.stories, 2 * specimen.stories
    a_n, by_ground, _ = numerical.relative_motion()
    a_e, by_interface, c_e = specimen.relative_motion()
    masses = np.asarray(specimen.masses)
    floors = np.hstack((np.zeros((specimen.stories, lower)), c_e))
    force = -feedback_scale * masses @ floors
    restoring = np.concatenate((numerical.interface_restoring(), np.zeros(upper)))
    acceleration = (force - restoring) / numerical.interface_mass
    a = np.zeros((lower + upper, lower + upper))
    a[:lower, :lower], a[lower:, lower:] = a_n, a_e
    a[lower // 2 : lower] += np.outer(numerical.interface_shares(), force / numerical.interface_mass)
    a[lower:] += by_interface * acceleration
    ground = np.vstack((by_ground, np.zeros((upper, 1))))
    transition, before, now = first_order_hold(a, ground, time_step)
    _, unmodelled = zero_order_hold(a, np.eye(lower + upper)[:, -specimen.stories :], time_step)
    return VirtualBuilding(transition, before, now, unmodelled, force, acceleration, floors)
