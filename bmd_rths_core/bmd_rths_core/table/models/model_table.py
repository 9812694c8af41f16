"""Base of every model of a table as a table controller: held commands, steps in order, no connection."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_core.table.models.sensors import Sensors


class ModelTable(ABC):
    """A table controller whose table is computed.

    Subclasses put their model at rest in `_rest` and advance it by one step in `_advance`.

    Parameters
    ----------
    sensors : Sensors
        Noise and quantisation.

    Attributes
    ----------
    motion : TrueMotion
        True motion at the end of the last step.
    """

    by_steps = True

    def __init__(self, sensors: Sensors) -> None:
        self._sensors = sensors
        self.connect()

    def connect(self) -> None:
        """Put the table at rest before step 0 and start the noise again from the seed."""
        self._sensors.reset()
        self._next_step = 0
        self._held = 0.0
        self._connected = True
        self.motion = TrueMotion()
        self._rest()

    def exchange(self, command: TableCommand) -> TableMeasurement:
        """Hold a command for one step.

        Parameters
        ----------
        command : TableCommand
            The command; steps that were skipped are simulated with the last command held.

        Returns
        -------
        TableMeasurement
            Sensors at the end of the step.

        Raises
        ------
        RuntimeError
            The table was stopped, or the step lies in the past.
        """
        if not self._connected:
            raise RuntimeError(f"command of step {command.step} refused: the simulated table is stopped")
        if command.step < self._next_step:
            raise RuntimeError(f"command of step {command.step} refused: step {self._next_step} is next")
        for skipped in range(self._next_step, command.step):
            self._advance(TableCommand(skipped, self._held))
        self._held = command.acceleration
        self._next_step = command.step + 1
        return self._advance(command)

    def stop(self) -> None:
        """Refuse further commands; the model needs no ramp to rest."""
        self._connected = False

    def emergency_stop(self) -> None:
        """Refuse further commands."""
        self._connected = False

    def close(self) -> None:
        """Refuse further commands; there is nothing to release."""
        self._connected = False

    def statistics(self) -> Mapping[str, str]:
        """Return nothing: a model has no connection."""
        return {}

    @abstractmethod
    def _rest(self) -> None:
        """Put the model at rest."""

    @abstractmethod
    def _advance(self, command: TableCommand) -> TableMeasurement:
        """Hold a command for one step, set `motion`, and read the sensors at the end of it."""
