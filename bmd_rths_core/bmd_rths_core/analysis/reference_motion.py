"""Displacements and drifts of the reference: the building without partition, relative to the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.reference import nonlinear_reference_motion
from bmd_rths_core.config import Config
from bmd_rths_core.integration.discretisation import DiscreteStateSpace, first_order_hold
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.record import RunRecord
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.nonlinear_building import nonlinear_building

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ReferenceMotion:
    """The n floors and stories of the whole building at the N steps, numerical stories first.

    Parameters
    ----------
    displacements : ndarray, shape (N, n)
        Relative to the ground [m].
    """

    displacements: FloatArray

    @property
    def drifts(self) -> FloatArray:
        """Story drifts, from the ground up, shape (N, n) [m]."""
        return np.diff(self.displacements, axis=1, prepend=0.0)


def reference_motion_of(record: RunRecord, config: Config) -> ReferenceMotion:
    """Return the motion of the reference of a run, whose accelerations are `metrics.reference_of`.

    Parameters
    ----------
    record : RunRecord
        The run, N steps. The ground motion is the recorded one.
    config : Config
        Its configuration.
    """
    ground = np.nan_to_num(record.ground_acceleration)
    upper = config.specimen.building().scaled(config.force_correction.feedback_scale)
    if config.nonlinear.linear_chain or config.nonlinear.integration == "exact":
        whole = upper.stacked_on(config.elastic_substructure())
        return ReferenceMotion(relative_displacements(whole, ground, config.run.time_step))
    building = nonlinear_building(config.numerical_substructure.building(), config.nonlinear).below(upper)
    return ReferenceMotion(nonlinear_reference_motion(building, ground, config.run.time_step)[1])


def relative_displacements(building: LinearBuilding, ground_acceleration: FloatArray, time_step: float) -> FloatArray:
    """Return the floor displacements of a building relative to the ground.

    Parameters
    ----------
    building : LinearBuilding
        n floors.
    ground_acceleration : ndarray, shape (N,)
        a_g [m/s²], linear between the steps.
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray, shape (N, n)
        u at the steps, exact for a piecewise-linear ground motion, from rest at step 0 [m].
    """
    if not len(ground_acceleration):
        return np.zeros((0, building.stories))
    a, b, _ = building.relative_motion()
    phi, gamma_0, gamma_1 = first_order_hold(a, b, time_step)
    c = np.hstack((np.eye(building.stories), np.zeros((building.stories, building.stories))))
    system = DiscreteStateSpace(phi, phi @ gamma_1 + gamma_0, c, c @ gamma_1)
    ground = ground_acceleration[:, None]
    (response,) = LinearSimulation(system, -gamma_1 * ground[:1]).advance(ground)
    return np.asarray(response.T)
