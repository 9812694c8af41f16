"""Reader of columns of numbers without a header, as programs of analysis take them (OpenSees, FEMA P-695)."""

from __future__ import annotations

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.dialect import Rows, are_numbers
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE
from bmd_rths_core.ground_motion.formats.time_column import step_of_times
from bmd_rths_core.ground_motion.formats.units import quoted

#: What a column is called that holds the time [s], and one that is passed over.
TIME, SKIPPED = "time", "-"
#: The columns of one series that goes on from line to line.
SERIES = "series"

_ROWS_LOOKED_AT = 40


def _recognises(file: RecordFile) -> bool:
    if not file.is_text:
        return False
    rows = Rows(file)
    beginning = rows.numbered[:_ROWS_LOOKED_AT]
    return bool(beginning) and all(are_numbers(rows.cells(line, rows.separator(line))) for _, line in beginning)


def _channels(file: RecordFile) -> list[Channel]:
    rows = Rows(file)
    numbered = rows.numbered
    names = [name.strip() for name in file.stated.columns.split(",")] if file.stated.columns != FROM_FILE else []
    if names:  # a person has said what the columns are, so that lines above them are not needed
        first = next((i for i, (_, line) in enumerate(numbered) if are_numbers(_cells(rows, line))), len(numbered))
        numbered = numbered[first:]
    table, line_numbers = [], []
    for line_number, line in numbered:
        separator = rows.separator(line)
        table.append([rows.number(line_number, cell, separator) for cell in rows.cells(line, separator)])
        line_numbers.append(line_number)
    if not table:
        raise InputError(f"{file.path}: no row of numbers")
    file.check_last_number(line_numbers[0])
    if names == [SERIES]:
        of_numbers = [n for n, row in zip(line_numbers, table, strict=True) for _ in row]
        return [_channel(file, "", None, np.array([value for row in table for value in row]), of_numbers)]
    width = len(table[0])
    for line_number, row in zip(line_numbers, table, strict=True):
        if len(row) != width:
            hint = f"; '{SERIES}' in ground_motion.columns (--columns) is for one series over all lines"
            raise file.error(line_number, f"{len(row)} numbers, where the line above has {width}{hint}")
    if not names and width > 1:
        problem = f"{width} columns of numbers; ground_motion.columns (--columns) must say what each is"
        example = f"'{TIME},acceleration', '{SKIPPED}' for one that is passed over, or '{SERIES}' for one series"
        raise InputError(f"{file.path}: {problem}: {example}")
    return _named(file, names or [""], np.array(table), line_numbers)


def _cells(rows: Rows, line: str) -> list[str]:
    return rows.cells(line, rows.separator(line))


def _named(file: RecordFile, names: list[str], table: np.ndarray, line_numbers: list[int]) -> list[Channel]:
    if len(names) != table.shape[1]:
        problem = f"ground_motion.columns (--columns) names {len(names)} columns in {quoted(file.stated.columns)}"
        raise InputError(f"{file.path}: {problem}; the file has {table.shape[1]}")
    times = [i for i, name in enumerate(names) if name.lower() == TIME]
    wanted = [i for i, name in enumerate(names) if i not in times and name != SKIPPED]
    if len(times) > 1 or not wanted or (len(names) > 1 and "" in names):
        problem = f"ground_motion.columns (--columns): {quoted(file.stated.columns)}"
        raise InputError(f"{problem}; at most one {TIME!r} and the name of one component or more are required")
    if len(table) < 2:
        raise InputError(f"{file.path}: {len(table)} rows of numbers; two or more are required")
    time_step = step_of_times(file, line_numbers, table[:, times[0]]) if times else None
    several = len(wanted) > 1
    return [_channel(file, names[i] if several else "", time_step, table[:, i], line_numbers) for i in wanted]


def _channel(
    file: RecordFile, name: str, time_step: float | None, values: np.ndarray, line_numbers: list[int]
) -> Channel:
    file.check_marks(values, line_numbers)
    return Channel(name, time_step, values, None)


NUMBERS = RecordFormat("columns of numbers", (), _recognises, _channels)
