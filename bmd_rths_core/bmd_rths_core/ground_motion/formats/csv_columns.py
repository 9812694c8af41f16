"""Reader of comma-separated files whose header row names the columns and their units."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import UNITS_READ, quoted, unit_factor
from bmd_rths_core.ground_motion.motion import GroundMotion

#: Largest deviation of one interval of the time column from the time step, as a part of the time step.
TIME_TOLERANCE = 1e-6

_EXAMPLE = "'time_s,acceleration_g'"
# "acceleration_m_s2", "acceleration [m/s^2]", "time (s)": a quantity, then a unit
_COLUMN = re.compile(r"([a-z]+)[ _]*[\[(]?([^\])]*)[\])]?")


def read_csv(path: str | Path) -> GroundMotion:
    """Read a CSV file with a time and an acceleration column.

    Lines that begin with ``#`` are comments. The first other line names the columns, in any order, with their units:
    ``time_s``, ``t_s`` or ``time [s]``, and ``acceleration_g`` or ``acceleration [g]``, likewise ``m_s2``, ``m/s^2``,
    ``cm_s2``, ``cm/s^2`` and ``gal``. Columns of other quantities are passed over; a second time or acceleration
    column is refused, because nothing says which is meant.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read; a column or its unit is missing or named twice; a value is not a finite number; or the
        time does not run from 0 in equal steps.
    """
    return CSV.read(path)


def _recognises(file: RecordFile) -> bool:
    header = next((line for line in file.lines if _is_row(line)), "") if file.is_text else ""
    quantities = [quantity for quantity, _ in _quantities(_cells(header))]
    return any(map(_is_time, quantities)) and any(map(_is_acceleration, quantities))


def _channels(file: RecordFile) -> list[Channel]:
    rows = [(n, line) for n, line in enumerate(file.lines, 1) if _is_row(line)]
    if len(rows) < 3:
        raise InputError(f"{file.path}: {len(rows)} rows; a header as {_EXAMPLE} and two rows of numbers are required")
    header_line, header = rows.pop(0)
    columns = _cells(header)
    time_column, acceleration_column, factor = _columns(file, header_line, columns)

    line_numbers, time, acceleration = [], [], []
    for line_number, line in rows:
        cells = _cells(line)
        if len(cells) != len(columns):
            raise file.error(line_number, f"{len(cells)} cells in {quoted(line)}; the header has {len(columns)}")
        line_numbers.append(line_number)
        time.append(file.number(line_number, cells[time_column]))
        acceleration.append(file.number(line_number, cells[acceleration_column]))
    time_step = _time_step(file, line_numbers, np.array(time))
    return [Channel("", time_step, np.array(acceleration), factor)]


def _cells(line: str) -> list[str]:
    return [cell.strip(' \t"') for cell in line.split(",")]


def _is_row(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _quantities(names: list[str]) -> list[tuple[str, str]]:
    """Return quantity and unit of each column."""
    found = [_COLUMN.fullmatch(name.lower()) for name in names]
    return [(match[1], match[2].replace("_", "/")) if match else ("", "") for match in found]


def _is_time(quantity: str) -> bool:
    return quantity in ("time", "t")


def _is_acceleration(quantity: str) -> bool:
    return quantity.startswith("acc")


def _columns(file: RecordFile, line_number: int, names: list[str]) -> tuple[int, int, float]:
    """Return the index of the time column, that of the acceleration column and the latter's unit in m/s²."""
    quantities = _quantities(names)
    time = [i for i, (quantity, _) in enumerate(quantities) if _is_time(quantity)]
    acceleration = [i for i, (quantity, _) in enumerate(quantities) if _is_acceleration(quantity)]
    for kind, found_columns in (("time", time), ("acceleration", acceleration)):
        if len(found_columns) != 1:
            problem = f"{len(found_columns)} {kind} columns in {quoted(','.join(names))}"
            raise file.error(line_number, f"{problem}; one is required, as in {_EXAMPLE}")
    if quantities[time[0]][1] != "s":
        raise file.error(line_number, f"no unit s in column {quoted(names[time[0]])}; 'time_s' is required")
    factor = unit_factor(quantities[acceleration[0]][1])
    if factor is None:
        column = quoted(names[acceleration[0]])
        raise file.error(line_number, f"no unit of acceleration in column {column}; {UNITS_READ} is required")
    return time[0], acceleration[0], factor


def _time_step(file: RecordFile, line_numbers: list[int], time: NDArray[np.float64]) -> float:
    intervals = np.diff(time)
    # The median is the step of the file even when a row is missing, so that the line at fault is the one named.
    step = float(np.median(intervals))
    if abs(time[0]) > TIME_TOLERANCE * abs(step):
        raise file.error(line_numbers[0], f"the first time is {time[0]:g} s; 0 is required")
    bad = np.flatnonzero((intervals <= 0) | (np.abs(intervals - step) > TIME_TOLERANCE * step))
    if bad.size:
        row = bad[0] + 1
        problem = f"time {time[row]:.9g} s is {intervals[row - 1]:.9g} s after the row before"
        raise file.error(line_numbers[row], f"{problem}; equal steps > 0 are required (median {step:.9g} s)")
    return float(time[-1] / (time.size - 1))


CSV = RecordFormat("CSV", (".csv",), _recognises, _channels)
