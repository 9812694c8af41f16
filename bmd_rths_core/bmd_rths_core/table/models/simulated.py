"""Simulated table with the specimen on it: exact discretisation, delay, sensor noise by seed, quantisation."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import DiscreteStateSpace, zero_order_hold
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.shear_building import chain_of
from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_core.table.models.damage import YieldingPlant
from bmd_rths_core.table.models.model_table import ModelTable
from bmd_rths_core.table.models.plant import Plant
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig

FloatArray = NDArray[np.float64]


class _Held(NamedTuple):
    """x[k+1] = Φ x[k] + newer u₁ + older u₀; the sensors see output x[k+1] + feedthrough u₁."""

    phi: FloatArray
    newer: FloatArray
    older: FloatArray
    output: FloatArray
    feedthrough: FloatArray


class SimulatedTable(ModelTable):
    """A table controller whose table and specimen are a linear model, unless its specimen softens or yields.

    The command is held over the step, delayed by any fraction of it, and the whole chain (table, specimen, table
    displacement) is advanced by one exact discretisation. The sensors are read at the end of the hold.

    Parameters
    ----------
    config : SimulatedTableConfig
        Table and sensors.
    specimen : LinearBuilding
        Model of what stands on the table, n floors.
    time_step : float
        Δt [s].
    seed : int
        Seed of the sensor noise.
    """

    def __init__(self, config: SimulatedTableConfig, specimen: LinearBuilding, time_step: float, seed: int) -> None:
        self._masses = np.asarray(specimen.masses)
        self._platen_mass = config.platen_mass
        whole, self._fraction = divmod(config.command_delay / time_step, 1.0)
        self._delay_steps, self._time_step = int(whole), time_step
        real = config.specimen(specimen)
        self._intact = self._discretised(config.plant(real))
        self._damaged, self._damaged_from = self._intact, math.inf
        if config.softening_factor != 1.0:
            self._damaged = self._discretised(config.plant(config.softened(real)))
            self._damaged_from = config.softening_step(time_step)
        self._yielding: YieldingPlant | None = None
        if config.yield_drifts:
            chain = chain_of(real, "simulated_table.yield_drifts")
            self._yielding = YieldingPlant(config.plant, chain, config.springs(real), time_step, self._fraction)
        super().__init__(config.sensors(specimen.stories, seed))

    def _discretised(self, plant: Plant) -> _Held:
        """Discretise: with a fractional delay the older command acts first and the newer for the rest of the step."""
        a, b, output, feedthrough = plant
        fraction, time_step = self._fraction, self._time_step
        phi, newer = zero_order_hold(a, b, (1.0 - fraction) * time_step)
        older = np.zeros_like(newer)
        if fraction > 0.0:
            first_phi, first_gamma = zero_order_hold(a, b, fraction * time_step)
            older = phi @ first_gamma
            phi = phi @ first_phi
        return _Held(phi, newer[:, 0], older[:, 0], output, feedthrough)

    def state_space(self, displacement: bool = False) -> DiscreteStateSpace:
        """Return table and intact specimen as a linear system, without noise and quantisation.

        Parameters
        ----------
        displacement : bool
            With the two integrators of the table displacement, which nothing depends on and which are not stable.

        Returns
        -------
        DiscreteStateSpace
            Input acceleration command; outputs accelerations of table and n floors [m/s²], base shear [N], and with
            the displacement that [m] and the actuator force [N]. The state is that of the model and the past commands,
            the newest first.
        """
        phi, held_newer, held_older, output, feedthrough = self._intact
        size, past = len(phi) - (0 if displacement else 2), self._delay_steps + 1
        # Commands that act in the second and in the first part of this step, of the past ones and the present one.
        commands = np.eye(past + 1)
        newer, older = commands[self._delay_steps], commands[past]
        of_commands = np.outer(held_newer[:size], newer) + np.outer(held_older[:size], older)
        a = np.zeros((size + past, size + past))
        b = np.zeros((size + past, 1))
        a[:size, :size] = phi[:size, :size]
        b[:size], a[:size, size:] = of_commands[:, :1], of_commands[:, 1:]
        b[size:], a[size:, size:] = commands[:past, :1], commands[:past, 1:]
        # What the sensors see of table, floors and displacement.
        sensors = np.vstack((np.eye(len(self._masses) + 1, len(self._masses) + 2), [0.0, *-self._masses, 0.0]))
        if displacement:
            force = [self._platen_mass, *self._masses, 0.0]
            sensors = np.vstack((sensors, np.eye(1, len(force), len(force) - 1), force))
        # The sensors are read at the end of the step, when the state is the next one.
        of_state = sensors @ output[:, :size]
        of_command = np.outer(sensors @ feedthrough, newer)
        return DiscreteStateSpace(
            a=a,
            b=b,
            c=of_state @ a[:size] + np.hstack((np.zeros((len(sensors), size)), of_command[:, 1:])),
            d=of_state @ b[:size] + of_command[:, :1],
        )

    def _rest(self) -> None:
        self._state = np.zeros(len(self._intact.phi))
        self._line = deque([0.0] * (self._delay_steps + 2), maxlen=self._delay_steps + 2)
        if self._yielding is not None:
            self._yielding.reset()

    def _advance(self, command: TableCommand) -> TableMeasurement:
        line = self._line
        line.append(command.acceleration)
        if self._yielding is None:
            held = self._damaged if command.step >= self._damaged_from else self._intact
            self._state = held.phi @ self._state + held.newer * line[1] + held.older * line[0]
            truth = held.output @ self._state + held.feedthrough * line[1]
        else:
            truth = self._yielding.step(line[0], line[1])
            self._state = self._yielding.state
        table, floors, displacement = truth[0], truth[1:-1], truth[-1]
        shear = -float(self._masses @ floors)
        force = float(self._platen_mass * table - shear)
        self.motion = TrueMotion(float(displacement), float(self._state[-1]), float(table), force)
        return self._sensors.read(
            step=command.step,
            applied_command=command.acceleration,
            displacement=float(displacement),
            accelerations=truth[:-1],
            actuator_force=force,
            base_shear=shear,
        )
