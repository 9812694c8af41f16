"""Reference: the unpartitioned building under the same earthquake, the benchmark of the paper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import DiscreteStateSpace, first_order_hold
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.nonlinear_building import NonlinearBuilding

FloatArray = NDArray[np.float64]

#: Steps that are computed at once: they fit into the cache of a processor.
_CHUNK = 2048


def reference_response(building: LinearBuilding, ground_acceleration: FloatArray, time_step: float) -> FloatArray:
    """Return the absolute floor accelerations of a building on the ground.

    Parameters
    ----------
    building : LinearBuilding
        The whole building, n floors (Eqs. 1 and 2).
    ground_acceleration : ndarray, shape (N,)
        a_g [m/s²], linear between the steps.
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray, shape (N, n)
        ü + ü_g at the steps, exact for a piecewise-linear ground motion, from rest at step 0 [m/s²].
    """
    return reference_responses(building, [ground_acceleration], time_step)[0]


def reference_responses(
    building: LinearBuilding, ground_accelerations: Sequence[FloatArray], time_step: float
) -> list[FloatArray]:
    """Return the responses of a building to many ground motions, computed together.

    Parameters
    ----------
    building : LinearBuilding
        The whole building, n floors (Eqs. 1 and 2).
    ground_accelerations : sequence of ndarray, each of shape (N,)
        a_g [m/s²], linear between the steps; of any length each.
    time_step : float
        Δt [s].

    Returns
    -------
    list of ndarray, each of shape (N, n)
        As `reference_response` has them.
    """
    a, b, c = building.relative_motion()
    phi, gamma_0, gamma_1 = first_order_hold(a, b, time_step)
    # The state is the motion at this step but for what the ground of this step adds, so that step 0 is at rest.
    system = DiscreteStateSpace(phi, phi @ gamma_1 + gamma_0, c, c @ gamma_1)
    lengths = [len(ground) for ground in ground_accelerations]
    grounds = np.zeros((max(1, *lengths), len(lengths)))  # a row to begin from, also for no step at all
    for i, ground in enumerate(ground_accelerations):
        grounds[: len(ground), i] = ground
    simulation = LinearSimulation(system, -gamma_1 * grounds[:1])
    parts = [simulation.advance(grounds[begin : begin + _CHUNK]) for begin in range(0, len(grounds), _CHUNK)]
    responses = np.concatenate(parts, axis=-1)
    return [response[:, :length].T for response, length in zip(responses, lengths, strict=True)]


def softened_reference_response(
    before: LinearBuilding, after: LinearBuilding, step: int, ground_acceleration: FloatArray, time_step: float
) -> FloatArray:
    """Return the absolute floor accelerations of a building that becomes another one during the earthquake.

    Parameters
    ----------
    before, after : LinearBuilding
        The whole building, n floors of the same masses.
    step : int
        Step at which it changes; what is returned of this step is still that of `before`.
    ground_acceleration : ndarray, shape (N,)
        a_g [m/s²], linear between the steps.
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray, shape (N, n)
        As `reference_response` has it.
    """
    a, b, c = before.relative_motion()
    phi, gamma_0, gamma_1 = first_order_hold(a, b, time_step)
    of_state = np.vstack((np.eye(len(a)), c))
    system = DiscreteStateSpace(phi, phi @ gamma_1 + gamma_0, of_state, of_state @ gamma_1)
    first = ground_acceleration[: step + 1, None]
    simulation = LinearSimulation(system, -gamma_1 * ground_acceleration[:1])
    intact: FloatArray = np.concatenate(
        [simulation.advance(first[begin : begin + _CHUNK])[0] for begin in range(0, len(first), _CHUNK)], axis=1
    )
    motion: FloatArray = intact[: len(a), -1:]
    response: FloatArray = intact[len(a) :].T
    a, b, c = after.relative_motion()
    phi, gamma_0, gamma_1 = first_order_hold(a, b, time_step)
    system = DiscreteStateSpace(phi, phi @ gamma_1 + gamma_0, c, c @ gamma_1)
    left = ground_acceleration[step + 1 :, None]
    if not len(left):
        return response
    simulation = LinearSimulation(system, phi @ motion + gamma_0 * ground_acceleration[step])
    parts = [simulation.advance(left[begin : begin + _CHUNK])[0] for begin in range(0, len(left), _CHUNK)]
    whole: FloatArray = np.vstack((response, np.concatenate(parts, axis=1).T))
    return whole


def nonlinear_reference_response(
    building: NonlinearBuilding, ground_acceleration: FloatArray, time_step: float, substeps: int = 10
) -> FloatArray:
    """Return the absolute floor accelerations of a non-linear building on the ground.

    Parameters
    ----------
    building : NonlinearBuilding
        The whole building, n floors, in its virgin state.
    ground_acceleration : ndarray, shape (N,)
        a_g [m/s²], linear between the steps.
    time_step : float
        Δt [s].
    substeps : int
        Sub-steps of each step.

    Returns
    -------
    ndarray, shape (N, n)
        ü + ü_g at the steps, from rest at step 0 [m/s²].
    """
    return nonlinear_reference_motion(building, ground_acceleration, time_step, substeps)[0]


def nonlinear_reference_motion(
    building: NonlinearBuilding, ground_acceleration: FloatArray, time_step: float, substeps: int = 10
) -> tuple[FloatArray, FloatArray]:
    """Return accelerations and displacements of the floors of a non-linear building on the ground.

    Parameters
    ----------
    building, ground_acceleration, time_step, substeps
        As for `nonlinear_reference_response`.

    Returns
    -------
    accelerations : ndarray, shape (N, n)
        ü + ü_g at the steps, from rest at step 0 [m/s²].
    displacements : ndarray, shape (N, n)
        u relative to the ground [m].

    Notes
    -----
    Pseudo-force method: the building with its initial stiffness K is propagated exactly, and what the stories
    deviate from it, q = K u − r(u), is a load that is linear over a sub-step: extrapolated to predict u, then corrected
    once. The method has second order, and is exact as long as no story deviates: then it is `reference_response`.
    """
    n = len(building.masses)
    inverse_mass = 1.0 / building.masses[:, None]
    stiffness = building.initial_stiffness_matrix
    motion = -inverse_mass * np.hstack((stiffness, building.damping_matrix))
    a = np.vstack((np.hstack((np.zeros((n, n)), np.eye(n))), motion))
    b = np.vstack((np.zeros((n, n + 1)), np.hstack((-np.ones((n, 1)), np.diag(inverse_mass[:, 0])))))
    phi, gamma_0, gamma_1 = first_order_hold(a, b, time_step / substeps)
    propagate = np.hstack((phi, gamma_0, gamma_1))
    correct = gamma_1[:, 1:]
    stories = building.stories()
    stories.reset()
    state, deviation, last_deviation = np.zeros(2 * n), np.zeros(n), np.zeros(n)
    response, displacements = np.zeros((2, len(ground_acceleration), n))
    if not len(ground_acceleration):
        return response, displacements
    fine = np.interp(
        np.arange((len(ground_acceleration) - 1) * substeps + 1) / substeps,
        np.arange(len(ground_acceleration)),
        ground_acceleration,
    )
    for i in range(1, len(fine)):
        extrapolated = 2.0 * deviation - last_deviation
        state = propagate @ np.concatenate((state, fine[i - 1 : i], deviation, fine[i : i + 1], extrapolated))
        last_deviation = deviation
        deviation = stiffness @ state[:n] - stories.floor_forces(state[:n])
        state += correct @ (deviation - extrapolated)
        if i % substeps == 0:
            response[i // substeps] = motion @ state + inverse_mass[:, 0] * deviation
            displacements[i // substeps] = state[:n]
    return response, displacements
