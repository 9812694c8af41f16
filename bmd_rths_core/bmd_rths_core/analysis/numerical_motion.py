"""Motion and forces of the numerical substructure, computed again from what is in the record.

The record holds what the substructure was driven by, not its displacements. The stage itself, given the same
inputs, returns them, and with sub-steps what it predicted between its targets. The shear that acted at a step is its
`required_force`, whichever shear that was in real time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.table_peaks import peak
from bmd_rths_core.analysis.whole_samples import filled
from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_integrated_stage, make_stability_indicator_array
from bmd_rths_core.record import RunRecord
from bmd_rths_core.structure.nonlinear_building import nonlinear_building
from bmd_rths_core.structure.shear_building import ShearBuilding

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class NumericalMotion:
    """The n floors and stories of the numerical substructure at the N steps.

    Parameters
    ----------
    displacements, velocities : ndarray, shape (N, n)
        Relative to the ground [m, m/s].
    accelerations : ndarray, shape (N, n)
        Absolute, as the desired acceleration is [m/s²].
    drifts : ndarray, shape (N, n)
        Story drifts, from the ground up [m].
    story_forces : ndarray, shape (N, n)
        Restoring forces of the stories, P-Δ included, without damping [N].
    ground_acceleration, shear : ndarray, shape (N,)
        What drove it, gaps bridged [m/s², N].
    deviation_percent : float
        Largest difference to the recorded desired acceleration over its peak [%]: rounding in a complete record.
    """

    displacements: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    drifts: FloatArray
    story_forces: FloatArray
    ground_acceleration: FloatArray
    shear: FloatArray
    deviation_percent: float


def numerical_motion(record: RunRecord, config: Config) -> NumericalMotion:
    """Compute the motion of the numerical substructure again.

    Parameters
    ----------
    record : RunRecord
        The run.
    config : Config
        Its configuration.

    Returns
    -------
    NumericalMotion
    """
    ground, shear = filled(record.ground_acceleration), filled(record.required_force)
    stage, substeps = make_integrated_stage(config, ground), config.numerical_substructure.substeps
    stage.reset()
    # Stories that yield have been asked for their forces at the targets alone.
    apart = substeps if config.nonlinear.integration != "exact" else 1
    building = config.elastic_substructure()
    floor_forces = _floor_forces(config)
    shape = record.steps, len(building.masses)
    displacements, velocities, forces = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for k, (ground_now, shear_now) in enumerate(zip(ground.tolist(), shear.tolist(), strict=True)):
        stage.step(ground_now, shear_now)
        displacements[k], velocities[k] = stage.displacements, stage.velocities
        if k % apart == 0:
            forces[k] = floor_forces(displacements[k])
    forces = _between(forces, apart)
    load = -forces - velocities @ building.damping_matrix
    load[:, -1] += shear
    accelerations = np.linalg.solve(building.mass_matrix, load.T).T
    difference = peak((accelerations[:, -1] - record.desired_acceleration)[::apart])
    largest = peak(record.desired_acceleration)
    return NumericalMotion(
        displacements,
        velocities,
        accelerations,
        drifts=np.diff(displacements, axis=1, prepend=0.0),
        story_forces=np.cumsum(forces[:, ::-1], axis=1)[:, ::-1],
        ground_acceleration=ground,
        shear=shear,
        deviation_percent=100.0 * difference / largest if largest > 0.0 else 0.0,
    )


def _between(values: FloatArray, apart: int) -> FloatArray:
    """Return values, of which every so manieth row is known, with the others on the lines between."""
    known, rows = np.arange(0, len(values), apart), np.arange(len(values))
    if apart == 1 or not len(values):
        return values
    return np.stack([np.interp(rows, known, column[known]) for column in values.T], axis=1)


def peak_drifts(record: RunRecord, config: Config) -> tuple[float, ...]:
    """Return the largest drift of every story of the numerical substructure, from the ground up [m].

    Parameters
    ----------
    record : RunRecord
        The run.
    config : Config
        Its configuration.
    """
    return tuple(peak(drift) for drift in numerical_motion(record, config).drifts.T)


def _floor_forces(config: Config) -> Callable[[FloatArray], FloatArray]:
    """Return the restoring forces on the floors by their displacements, without damping."""
    building = config.numerical_substructure.building()
    if not isinstance(building, ShearBuilding):
        stiffness = building.stiffness_matrix
        return lambda displacements: np.asarray(stiffness @ displacements)
    stories = nonlinear_building(building, config.nonlinear).stories()
    stories.reset()
    return stories.floor_forces


def ductility(motion: NumericalMotion, config: Config) -> tuple[float, ...]:
    """Return the ductility of every story, peak drift over yield drift.

    Parameters
    ----------
    motion : NumericalMotion
        The numerical substructure.
    config : Config
        Its configuration, with stories that can yield.
    """
    pairs = zip(motion.drifts.T, config.nonlinear.yield_drifts, strict=True)
    return tuple(peak(drift) / float(yield_drift) for drift, yield_drift in pairs)


def stability_indicator(motion: NumericalMotion, config: Config) -> FloatArray:
    """Return the stability indicator at every step, whether it was watched in the run or not.

    Parameters
    ----------
    motion : NumericalMotion
        The numerical substructure.
    config : Config
        Its configuration.

    Returns
    -------
    ndarray, shape (N,)
        See `bmd_rths_core.safety.StabilityIndicator`.
    """
    if not len(motion.shear):
        return np.zeros(0)
    fed_back = np.append(motion.shear[1:], 0.0)  # the shear fed back at step k acts at step k + 1
    (indicator,) = make_stability_indicator_array(config, 1).advance(fed_back[None], motion.displacements.T[None])
    return np.asarray(indicator)
