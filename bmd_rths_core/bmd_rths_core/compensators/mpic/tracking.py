"""How MPIC drives the table: linear-quadratic tracking of the virtual interface with preview of the ground motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.mpic.riccati import Pieces, RiccatiSolver, at_once, finished
from bmd_rths_core.compensators.mpic.virtual_building import VirtualBuilding
from bmd_rths_core.errors import InputError
from bmd_rths_core.table.models.held_plant import HeldPlant

FloatArray = NDArray[np.float64]


class TrackingWeights(NamedTuple):
    """Weights of the cost, relative to the square of the interface error a_t − a_N.

    Parameters
    ----------
    floors : float
        Of the square of each floor of the specimen less its virtual one.
    command : float
        Of the square of the command.
    centring : float
        ω_c, frequency below which the displacement of the table counts more than its acceleration [rad/s].
    """

    floors: float
    command: float
    centring: float


class ErrorSystem(NamedTuple):
    """X[k+1] = A X[k] + B u[k] + E a_g[k+1] with X = [x, x_b, a_g]; displacement and velocity in x are errors.

    Parameters
    ----------
    transition : ndarray, shape (m, m)
    command : ndarray, shape (m, 1)
    ground : ndarray, shape (m, 1)
    error : ndarray, shape (n + 1, m)
        Rows of a_t − a_N and of the floors less the virtual ones [m/s²].
    displacement : int
        Index of e_d, the displacement of the table less that of the interface with the ground; e_v follows.
    """

    transition: FloatArray
    command: FloatArray
    ground: FloatArray
    error: FloatArray
    displacement: int


class Tracking(NamedTuple):
    """u[k] = −K X[k] − Σ_j F_j a_g[k+1+j].

    Parameters
    ----------
    gain : ndarray, shape (m,)
        K.
    preview : ndarray, shape (p,)
        F.
    cost : ndarray, shape (m, m)
        Solution P of the Riccati equation.
    """

    gain: FloatArray
    preview: FloatArray
    cost: FloatArray


def error_system(plant: HeldPlant, building: VirtualBuilding, time_step: float) -> ErrorSystem:
    """Put table and virtual building together; the double integrals of the ground drop out of the errors.

    Parameters
    ----------
    plant : HeldPlant
        Table and specimen.
    building : VirtualBuilding
        What the table has to follow.
    time_step : float
        Δt [s].

    Returns
    -------
    ErrorSystem
    """
    of_plant, of_building = len(plant.transition), len(building.force)
    size = of_plant + of_building + 1
    virtual = slice(of_plant, size - 1)
    a, b, e = np.zeros((size, size)), np.zeros((size, 1)), np.zeros((size, 1))
    a[:of_plant, :of_plant], b[:of_plant] = plant.transition, plant.command
    a[virtual, virtual], a[virtual, -1:] = building.transition, building.ground_before
    e[virtual], e[-1] = building.ground_now, 1.0
    # e = (displacement of the table) − (that of the interface + that of the ground). Both advance by Δt times their
    # velocity, which is Δt e_v, so that only the rest of the interface has to be taken away.
    d, v = plant.displacement, plant.displacement + 1
    interface, speed = (of_plant + index for index in building.interface)
    for row, own, moving in ((d, interface, time_step), (v, speed, 0.0)):
        a[row] -= a[own]
        a[row, own] += 1.0
        a[row, speed] += moving
        e[row] -= e[own]
    # The ground moves with an acceleration that is linear over the step.
    a[d, -1] -= time_step**2 / 3.0
    e[d] -= time_step**2 / 6.0
    a[v, -1] -= time_step / 2.0
    e[v] -= time_step / 2.0
    error = np.zeros((len(building.floors) + 1, size))
    error[:, :of_plant] = plant.output[:-1]
    error[0, virtual] -= building.acceleration
    error[1:, virtual] -= building.floors
    return ErrorSystem(a, b, e, error, d)


def tracking(system: ErrorSystem, weights: TrackingWeights, preview: int) -> Tracking:
    """Return the optimal feedback and the feedforward of the ground motion that is known in advance.

    Parameters
    ----------
    system : ErrorSystem
        What is controlled.
    weights : TrackingWeights
        Of the cost.
    preview : int
        Steps p of the ground motion that are known in advance.

    Returns
    -------
    Tracking

    Raises
    ------
    InputError
        The Riccati equation has no stabilising solution: the model of the table cannot be controlled.

    Notes
    -----
    With S = ρ + Bᵀ P B and A_c = A − B K, what is known of the ground enters as F_j = S⁻¹ Bᵀ (A_cᵀ)ʲ P E.
    """
    return finished(tracking_in_pieces(system, weights, preview))


def tracking_in_pieces(
    system: ErrorSystem, weights: TrackingWeights, preview: int, solve: RiccatiSolver = at_once
) -> Pieces[Tracking]:
    """Return the work of `tracking`.

    Parameters
    ----------
    system, weights, preview
        As `tracking` takes them.
    solve : RiccatiSolver
        Solves the Riccati equation.
    """
    a, b, e, error, d = system
    own = np.append(1.0, np.full(len(error) - 1, weights.floors))
    state_cost = error.T @ (own[:, None] * error)
    state_cost[d, d] += weights.centring**4
    state_cost[d + 1, d + 1] += weights.centring**2
    command_cost = np.array([[weights.command]])
    try:
        cost = yield from solve(a, b, state_cost, command_cost)
    except (np.linalg.LinAlgError, ValueError) as problem:
        raise InputError(f"mpic: the identified table cannot be controlled ({problem})") from problem
    weight = command_cost + b.T @ cost @ b
    gain = np.linalg.solve(weight, b.T @ cost @ a)
    closed = a - b @ gain
    ahead, feedforward = cost @ e, np.zeros(preview)
    for j in range(preview):
        feedforward[j] = np.linalg.solve(weight, b.T @ ahead).item()
        ahead = closed.T @ ahead
    return Tracking(gain[0], feedforward, cost)
