"""A plant whose command is held and delayed, from one step to the next, with every output a row of the state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import zero_order_hold
from bmd_rths_core.table.models.plant import Plant

FloatArray = NDArray[np.float64]


class HeldPlant(NamedTuple):
    """x[k+1] = A x[k] + B u[k]; the sensors at the end of step k see C x[k+1].

    Parameters
    ----------
    transition : ndarray, shape (m, m)
        A. The state is that of the plant, its last two displacement and velocity of the table, then the past commands
        that still act, the newest first.
    command : ndarray, shape (m, 1)
        B.
    unknown : ndarray, shape (m, 1)
        What an error of the command that acts during the step adds to the state of the plant.
    unmodelled : ndarray, shape (m, n)
        What an unmodelled acceleration of each floor, held over the step, adds to the state.
    output : ndarray, shape (n + 2, m)
        C: absolute accelerations of table and n floors [m/s²], displacement of the table [m].
    size : int
        States of the plant, without past commands.
    """

    transition: FloatArray
    command: FloatArray
    unknown: FloatArray
    unmodelled: FloatArray
    output: FloatArray
    size: int

    @property
    def displacement(self) -> int:
        """Index of the displacement of the table; its velocity follows."""
        return self.size - 2

    @property
    def floors(self) -> slice:
        """The displacements and velocities of the n floors relative to the table."""
        stories = len(self.output) - 2
        return slice(self.size - 2 - 2 * stories, self.size - 2)


def held_plant(plant: Plant, delay: float, time_step: float) -> HeldPlant:
    """Discretise a plant exactly.

    Parameters
    ----------
    plant : Plant
        Table and specimen.
    delay : float
        Pure delay of the command, ≥ 0, in full or fractional time steps [s].
    time_step : float
        Δt [s].

    Returns
    -------
    HeldPlant
    """
    whole, fraction = divmod(delay / time_step, 1.0)
    # With a fractional delay the older command acts for the first part of the step and the newer for the rest.
    transition, newer = zero_order_hold(plant.a, plant.b, (1.0 - fraction) * time_step)
    older = np.zeros_like(newer)
    if fraction > 0.0:
        first, by_first = zero_order_hold(plant.a, plant.b, fraction * time_step)
        older, transition = transition @ by_first, transition @ first
    acts = delay > 0.0 or plant.feedthrough.any()
    size, past, steps = len(plant.a), (int(whole) + 1 if acts else 0), int(whole)
    commands = np.eye(past + 1)
    of_commands = np.outer(newer, commands[steps])
    if fraction > 0.0:
        of_commands += np.outer(older, commands[steps + 1])
    a, b = np.zeros((size + past, size + past)), np.zeros((size + past, 1))
    a[:size, :size], a[:size, size:], b[:size] = transition, of_commands[:, 1:], of_commands[:, :1]
    a[size:, size:], b[size:] = commands[:past, 1:], commands[:past, :1]
    output = np.hstack((plant.output, np.zeros((len(plant.output), past))))
    if acts:  # after the step the command that acted last is the past one with this index
        output[:, size + steps] = plant.feedthrough
    unknown = np.vstack((newer + older, np.zeros((past, 1))))
    stories = len(plant.output) - 2
    velocities = np.eye(size)[:, size - 2 - stories : size - 2]
    _, unmodelled = zero_order_hold(plant.a, velocities, time_step)
    return HeldPlant(a, b, unknown, np.vstack((unmodelled, np.zeros((past, stories)))), output, size)
