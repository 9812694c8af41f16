"""The observer of MPIC: one steady-state Kalman filter of the table, the specimen on it and the virtual building.

The virtual building is what the building would do on a table that follows exactly. It is not measured, but what the
model of the specimen does not know acts on both, on the real specimen and on the virtual one. So an innovation tells
about the virtual building too, numerical floors included, and the filter of all states together has the least error
that these sensors allow for the errors that are assumed (Kalman 1960; Anderson and Moore, "Optimal Filtering", 1979).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.mpic.riccati import Pieces, RiccatiSolver, at_once, finished
from bmd_rths_core.compensators.mpic.virtual_building import VirtualBuilding
from bmd_rths_core.compensators.protocol import SensorNoise
from bmd_rths_core.errors import InputError
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.table.models.held_plant import HeldPlant

FloatArray = NDArray[np.float64]


class ModelError(NamedTuple):
    """What the filter assumes its models not to know, root mean square, white over the steps.

    Parameters
    ----------
    command : float
        Error of the command as it acts on the table [m/s²].
    floors : float
        Unmodelled acceleration of every floor of the specimen, held over the step [m/s²].
    """

    command: float
    floors: float


class Observer(NamedTuple):
    """x̂ = x̂⁻ + K (y − C x̂⁻) for the state of the plant, and the same innovation for the virtual building.

    Parameters
    ----------
    measurement : ndarray, shape (q, m)
        C: what of the state of the plant the sensors see, in the order of `measured`.
    plant_gain : ndarray, shape (m, q)
    building_gain : ndarray, shape (b, q)
    covariance : ndarray, shape (m + b, m + b)
        Of the errors before the update.
    noise : ndarray, shape (q, q)
        Covariance of the sensors.
    """

    measurement: FloatArray
    plant_gain: FloatArray
    building_gain: FloatArray
    covariance: FloatArray
    noise: FloatArray


def sensor_rows(
    plant: HeldPlant, specimen: LinearBuilding, noise: SensorNoise, load_cell: bool
) -> tuple[FloatArray, FloatArray]:
    """Return what the sensors see of the plant, table, floors, displacement and load cell, and their noise.

    Parameters
    ----------
    plant : HeldPlant
        m states.
    specimen : LinearBuilding
        n floors.
    noise : SensorNoise
        Of the sensors.
    load_cell : bool
        The base shear is measured.

    Returns
    -------
    rows : ndarray, shape (n + 2, m) or with a load cell (n + 3, m)
    deviations : ndarray, shape (n + 2,) or (n + 3,)
    """
    stories = specimen.stories
    deviations = np.append(np.full(stories + 1, noise.acceleration), noise.displacement)
    if not load_cell:
        return plant.output, deviations
    shear = -np.asarray(specimen.masses) @ plant.output[1 : stories + 1]
    return np.vstack((plant.output, shear)), np.append(deviations, noise.shear)


def observer(
    plant: HeldPlant,
    building: VirtualBuilding,
    specimen: LinearBuilding,
    noise: SensorNoise,
    load_cell: bool,
    error: ModelError,
) -> Observer:
    """Return the filter in its steady state.

    Parameters
    ----------
    plant : HeldPlant
        Table and specimen.
    building : VirtualBuilding
        With the same model of the specimen.
    specimen : LinearBuilding
        That model.
    noise : SensorNoise
        Of the sensors.
    load_cell : bool
        The base shear is measured.
    error : ModelError
        Of the models.

    Returns
    -------
    Observer

    Raises
    ------
    InputError
        There is no steady state with these noise levels.
    """
    return finished(observer_in_pieces(plant, building, specimen, noise, load_cell, error))


def observer_in_pieces(
    plant: HeldPlant,
    building: VirtualBuilding,
    specimen: LinearBuilding,
    noise: SensorNoise,
    load_cell: bool,
    error: ModelError,
    solve: RiccatiSolver = at_once,
) -> Pieces[Observer]:
    """Return the work of `observer`.

    Parameters
    ----------
    plant, building, specimen, noise, load_cell, error
        As `observer` takes them.
    solve : RiccatiSolver
        Solves the Riccati equation.
    """
    from scipy.linalg import block_diag  # not before it is needed

    measurement, deviations = sensor_rows(plant, specimen, noise, load_cell)
    size = len(plant.transition)
    acting = error.floors * np.vstack((plant.unmodelled, building.unmodelled))
    by_command = error.command * np.vstack((plant.unknown, np.zeros((len(building.force), 1))))
    process = acting @ acting.T + by_command @ by_command.T
    transition = block_diag(plant.transition, building.transition)
    seen = np.hstack((measurement, np.zeros((len(measurement), len(building.force)))))
    covariance = np.diag(deviations**2)
    try:
        prior = yield from solve(transition.T, seen.T, process, covariance)
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise InputError(f"mpic: the observer has no steady state with these noise levels ({problem})") from problem
    gain = np.linalg.solve(seen @ prior @ seen.T + covariance, seen @ prior).T
    return Observer(measurement, gain[:size], gain[size:], prior, covariance)
