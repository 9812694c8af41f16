"""The signals of a run that is under way: they come one by one, in any order, and some never."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.signals import MEASUREMENT, SCALAR_TOPICS, SIGNALS
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]

#: Steps there is room for at first; the room is doubled when it is full.
_ROOM = 4096


class GrowingColumns:
    """Columns of numbers that grow together; what was never put is NaN."""

    def __init__(self) -> None:
        self._columns: dict[str, FloatArray] = {}
        self.rows = 0

    def put(self, name: str, row: int, value: float | FloatArray) -> None:
        """Put a value, or a row of values, into a column.

        Parameters
        ----------
        name : str
            The column; it is made with its first value.
        row : int
            Where.
        value : float or ndarray
            A number, or one for every part of the column.
        """
        self._room_for(name, row + 1, np.shape(value))[row] = value

    def extend(self, name: str, begin: int, values: FloatArray) -> None:
        """Put the values of consecutive rows.

        Parameters
        ----------
        name : str
            The column.
        begin : int
            First row.
        values : ndarray, shape (m,) or (m, n)
            The values.
        """
        self._room_for(name, begin + len(values), values.shape[1:])[begin : begin + len(values)] = values

    def __getitem__(self, name: str) -> FloatArray:
        """Return a column, shape (rows,) or (rows, n); NaN everywhere when nothing was put into it."""
        if name not in self._columns:
            return np.full(self.rows, np.nan)
        column = self._columns[name]
        if len(column) < self.rows:
            column = self._room_for(name, self.rows, column.shape[1:])
        return column[: self.rows]

    def _room_for(self, name: str, rows: int, shape: tuple[int, ...]) -> FloatArray:
        self.rows = max(self.rows, rows)
        column = self._columns.get(name)
        if column is None or len(column) < self.rows:
            room = max(_ROOM, 1 << (self.rows - 1).bit_length())
            larger = np.full((room, *shape), np.nan)
            if column is not None:
                larger[: len(column)] = column
            self._columns[name] = column = larger
        return column


class LiveSignals:
    """Signals of a run by step, as far as they have come.

    Attributes
    ----------
    columns : GrowingColumns
        One column for every signal of `signals.SIGNALS`.
    floors : int
        Number of measured floors; 0 before the first measurement.
    """

    def __init__(self) -> None:
        self.columns = GrowingColumns()
        self.floors = 0
        self._next = dict.fromkeys((*SCALAR_TOPICS, MEASUREMENT), 0)

    def put(self, signal: str, step: int, value: float) -> None:
        """Take the value of a signal that has a topic of its own.

        Parameters
        ----------
        signal : str
            One of `signals.SCALAR_TOPICS`.
        step : int
            Its step.
        value : float
            The value.
        """
        self.columns.put(signal, step, value)
        self._next[signal] = max(self._next[signal], step + 1)

    def put_measurement(self, measurement: TableMeasurement) -> None:
        """Take what the table controller measured.

        Parameters
        ----------
        measurement : TableMeasurement
            Of one step.
        """
        for name in TableMeasurement._fields[1:]:
            self.columns.put(name, measurement.step, getattr(measurement, name))
        self.floors = len(measurement.floor_accelerations)
        self._next[MEASUREMENT] = max(self._next[MEASUREMENT], measurement.step + 1)

    @property
    def steps(self) -> int:
        """Number of steps of which anything has come."""
        return self.columns.rows

    @property
    def complete(self) -> int:
        """Number of steps after which every topic has come at least once: nothing is expected before it any more."""
        return min(self._next.values())

    def signals(self) -> dict[str, FloatArray]:
        """Return every signal by name, as `RunRecord.signals` does."""
        found = {signal.name: self.columns[signal.name] for signal in SIGNALS}
        if not self.floors:
            found["floor_accelerations"] = np.full((self.steps, 0), np.nan)
        return found
