"""Drive a table with an excitation and record what its sensors say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.frequency_response import FloatArray
from bmd_rths_core.record import RunRecord
from bmd_rths_core.safety import SafetySupervisor, bring_to_rest
from bmd_rths_core.table.controller import TableCommand, TableController

#: How often `drive` reports progress [steps].
PROGRESS_PERIOD = 200


@dataclass(frozen=True)
class Responses:
    """What a table and a specimen did, without gaps; row k belongs to command k and was read at its end.

    Parameters
    ----------
    time_step : float
        Δt [s].
    command : ndarray, shape (N,)
        Acceleration command that was applied [m/s²].
    table : ndarray, shape (N,)
        Measured absolute acceleration of the table [m/s²].
    floors : ndarray, shape (N, n)
        Measured absolute accelerations of the floors, from the table up [m/s²].
    source : str
        Where the responses come from, in words.
    """

    time_step: float
    command: FloatArray
    table: FloatArray
    floors: FloatArray
    source: str

    @property
    def largest_table(self) -> float:
        """Largest absolute acceleration of the table [m/s²]."""
        return float(np.max(np.abs(self.table)))

    @property
    def largest_floor(self) -> float:
        """Largest absolute acceleration of any floor [m/s²]."""
        return float(np.max(np.abs(self.floors)))


class DrivingStopped(Exception):
    """A limit ended the drive; the text says which."""


def drive(
    table: TableController,
    supervisor: SafetySupervisor,
    commands: FloatArray,
    time_step: float,
    progress: Callable[[int], None] | None = None,
) -> Responses:
    """Drive a table with given commands; it is brought to rest, stopped and closed whatever happens.

    Parameters
    ----------
    table : TableController
        The table.
    supervisor : SafetySupervisor
        Limits, and the way to rest at the end.
    commands : ndarray, shape (N,)
        Acceleration commands [m/s²].
    time_step : float
        Δt the table runs with [s].
    progress : callable, optional
        Called with the number of finished steps every `PROGRESS_PERIOD` steps and at the end.

    Returns
    -------
    Responses

    Raises
    ------
    DrivingStopped
        A limit was passed; the table is at rest.
    InputError
        A sensor that is needed gave no value.
    """
    rows = []
    table.connect()
    try:
        for k, command in enumerate(commands.tolist()):
            if not supervisor.check(k, command):
                break
            measured = table.exchange(TableCommand(k, command))
            supervisor.observe(measured)
            rows.append((measured.applied_command, measured.table_acceleration, *measured.floor_accelerations))
            if progress is not None and (k + 1) % PROGRESS_PERIOD == 0:
                progress(k + 1)
        bring_to_rest(table, supervisor)
    finally:
        table.stop()
        table.close()
    if supervisor.reason:
        raise DrivingStopped(supervisor.reason)
    if progress is not None:
        progress(len(rows))
    signals = np.array(rows)
    missing = np.flatnonzero(~np.isfinite(signals).all(axis=1))
    if len(missing):
        raise InputError(f"identification: step {missing[0]} has no acceleration of table or floors; all are required")
    return Responses(time_step, signals[:, 0], signals[:, 1], signals[:, 2:], "driven")


def responses_of(record: RunRecord) -> Responses:
    """Return the longest stretch of a record that has no gap.

    Parameters
    ----------
    record : RunRecord
        A run, for example from a bag.

    Returns
    -------
    Responses
        Its source says which steps were taken.

    Raises
    ------
    InputError
        No step has all signals.
    """
    signals = np.column_stack((record.applied_command, record.table_acceleration, record.floor_accelerations))
    whole = np.isfinite(signals).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], whole, [False]))))
    stretches = edges.reshape(-1, 2)
    if not len(stretches):
        raise InputError(f"{record.source}: no step has applied command and accelerations of table and floors")
    first, end = stretches[np.argmax(stretches[:, 1] - stretches[:, 0])]
    source = f"steps {first} to {end - 1} of {record.steps} of {record.source}"
    own = signals[first:end]
    return Responses(record.time_step, own[:, 0], own[:, 1], own[:, 2:], source)
