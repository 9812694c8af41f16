"""Variant R of MPIC: the virtual building corrected by a specimen that the measured motion of the table drives.

The joint observer explains what the floors do by table and specimen together, and blames the specimen for what the
model of the table does not know. Here the table is an input that is measured: its model does not enter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.mpic.riccati import Pieces, RiccatiSolver, at_once, finished
from bmd_rths_core.compensators.mpic.virtual_building import VirtualBuilding
from bmd_rths_core.compensators.protocol import SensorNoise
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import first_order_hold, zero_order_hold
from bmd_rths_core.structure.linear_building import LinearBuilding

FloatArray = NDArray[np.float64]


class SpecimenObserver(NamedTuple):
    """x⁻ = Φ x̂ + Γ₀ a_t[k−1] + Γ₁ a_t[k], x̂ = x⁻ + K (y − C x⁻); the same innovation for the virtual building.

    Parameters
    ----------
    transition : ndarray, shape (2n, 2n)
        Φ. The state is displacements and velocities of the floors relative to the table.
    before, now : ndarray, shape (2n, 1)
        Γ₀ and Γ₁, for an acceleration of the table that is linear over the step.
    measurement : ndarray, shape (q, 2n)
        C: floors, and the load cell where there is one.
    sensors : tuple of int
        Which of the sensors of the joint observer these are.
    gain : ndarray, shape (2n, q)
    building_gain : ndarray, shape (b, q)
    covariance : ndarray, shape (2n + b, 2n + b)
        Of the errors before the update.
    """

    transition: FloatArray
    before: FloatArray
    now: FloatArray
    measurement: FloatArray
    sensors: tuple[int, ...]
    gain: FloatArray
    building_gain: FloatArray
    covariance: FloatArray


def specimen_observer(
    building: VirtualBuilding,
    specimen: LinearBuilding,
    noise: SensorNoise,
    load_cell: bool,
    unmodelled: float,
    time_step: float,
) -> SpecimenObserver:
    """Return the filter of specimen and virtual building in its steady state.

    Parameters
    ----------
    building : VirtualBuilding
        With the same model of the specimen.
    specimen : LinearBuilding
        n floors.
    noise : SensorNoise
        Of the sensors; that of the table's accelerometer acts at both ends of a step.
    load_cell : bool
        The base shear is measured.
    unmodelled : float
        Unmodelled acceleration of every floor, held over the step, root mean square [m/s²].
    time_step : float
        Δt [s].

    Returns
    -------
    SpecimenObserver

    Raises
    ------
    InputError
        There is no steady state with these noise levels.
    """
    return finished(specimen_observer_in_pieces(building, specimen, noise, load_cell, unmodelled, time_step))


def specimen_observer_in_pieces(
    building: VirtualBuilding,
    specimen: LinearBuilding,
    noise: SensorNoise,
    load_cell: bool,
    unmodelled: float,
    time_step: float,
    solve: RiccatiSolver = at_once,
) -> Pieces[SpecimenObserver]:
    """Return the work of `specimen_observer`.

    Parameters
    ----------
    building, specimen, noise, load_cell, unmodelled, time_step
        As `specimen_observer` takes them.
    solve : RiccatiSolver
        Solves the Riccati equation.
    """
    from scipy.linalg import block_diag  # not before it is needed

    n = specimen.stories
    a, by_table, floors = specimen.relative_motion()
    transition, before, now = first_order_hold(a, by_table, time_step)
    _, acting = zero_order_hold(a, np.eye(2 * n)[:, n:], time_step)
    deviations = np.full(n, noise.acceleration)
    rows, sensors = floors, tuple(range(1, n + 1))
    if load_cell:
        rows = np.vstack((floors, -np.asarray(specimen.masses) @ floors))
        deviations, sensors = np.append(deviations, noise.shear), (*sensors, n + 2)
    both = unmodelled * np.vstack((acting, building.unmodelled))
    by_noise = noise.acceleration * np.vstack((np.hstack((before, now)), np.zeros((len(building.force), 2))))
    process = both @ both.T + by_noise @ by_noise.T
    seen = np.hstack((rows, np.zeros((len(rows), len(building.force)))))
    covariance = np.diag(deviations**2)
    try:
        prior = yield from solve(block_diag(transition, building.transition).T, seen.T, process, covariance)
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise InputError(
            f"mpic: the observer of the specimen has no steady state with these noise levels ({problem})"
        ) from problem
    gain = np.linalg.solve(seen @ prior @ seen.T + covariance, seen @ prior).T
    return SpecimenObserver(transition, before, now, rows, sensors, gain[: 2 * n], gain[2 * n :], prior)
