"""Protocol of a table that a virtual controller moves, and the simulated table as one."""

from __future__ import annotations

from typing import Protocol

from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_core.table.models.simulated import SimulatedTable


class VirtualTable(Protocol):
    """A model of a table that a virtual controller moves."""

    @property
    def reference(self) -> tuple[float, float]:
        """Displacement [m] and velocity [m/s] the table is asked to have."""

    @property
    def motion(self) -> TrueMotion:
        """True motion at the end of the last step."""

    def exchange(self, command: TableCommand) -> TableMeasurement:
        """Hold a command for one step and return the sensors at its end.

        Parameters
        ----------
        command : TableCommand
            The command; steps that were skipped are simulated with the last command held.
        """

    def degrade(self, valve: float, supply: float) -> None:
        """Change what the hydraulics can do.

        Parameters
        ----------
        valve, supply : float
            Valve opening and supply pressure that are left, as shares.
        """


class LinearTable:
    """The simulated table, with the double integral of its command as the reference.

    Parameters
    ----------
    table : SimulatedTable
        The table, at rest.
    time_step : float
        Its Δt [s].
    """

    def __init__(self, table: SimulatedTable, time_step: float) -> None:
        self._table = table
        self._time_step = time_step
        self._next_step = 0
        self._held = 0.0
        self._displacement = self._velocity = 0.0

    @property
    def reference(self) -> tuple[float, float]:
        """Displacement [m] and velocity [m/s] the table is asked to have."""
        return self._displacement, self._velocity

    @property
    def motion(self) -> TrueMotion:
        """True motion at the end of the last step."""
        return self._table.motion

    def exchange(self, command: TableCommand) -> TableMeasurement:
        """Hold a command for one step and return the sensors at its end."""
        self._follow(self._held, (command.step - self._next_step) * self._time_step)
        self._follow(command.acceleration, self._time_step)
        self._next_step, self._held = command.step + 1, command.acceleration
        return self._table.exchange(command)

    def degrade(self, valve: float, supply: float) -> None:
        """Do nothing: this table has no hydraulics."""

    def _follow(self, acceleration: float, duration: float) -> None:
        self._displacement += duration * (self._velocity + 0.5 * duration * acceleration)
        self._velocity += duration * acceleration
