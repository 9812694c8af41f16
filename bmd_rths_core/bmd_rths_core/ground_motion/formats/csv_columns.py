"""Reader of comma-separated files whose header row names the columns and their units."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bmd_rths_core.ground_motion.formats.csv_header import Column, column_of
from bmd_rths_core.ground_motion.formats.dialect import Rows, are_numbers
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE, ONLY
from bmd_rths_core.ground_motion.formats.time_column import step_of_times
from bmd_rths_core.ground_motion.formats.units import UNITS_READ, quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

_EXAMPLE = "'time_s,acceleration_g'"
#: Rows in which the one that names the columns is looked for; what stands above it is passed over.
_HEADER_ROWS = 60


def read_csv(path: str | Path, component: str = ONLY) -> GroundMotion:
    """Read a CSV file with a time column and columns of acceleration.

    Lines that begin with ``#`` or ``%`` are comments. A row names the columns, in any order, with their units:
    ``time_s``, ``t_s``, ``time [s]`` or ``Time (sec)``, and ``acceleration_g``, ``acceleration [g]`` or ``acc_ns_g``,
    likewise ``m_s2``, ``m/s^2``, ``cm_s2``, ``cm/s^2`` and ``gal``; units may also stand in a row of their own below.
    Several columns of acceleration are components, named by what stands beside quantity and unit. Columns of other
    quantities are passed over. Cells stand between commas, semicolons (a comma is then a decimal one), tabs or blanks.

    Parameters
    ----------
    path : str or Path
        The file.
    component : str
        Which of several columns, by its component or its whole name.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read; a column or its unit is missing; a value is not a finite number; or the time does not
        run from 0 in equal steps.
    """
    return CSV.read(path, component, FROM_FILE)


def _recognises(file: RecordFile) -> bool:
    return file.is_text and not file.head.startswith(("{", "[")) and _header(Rows(file)) is not None


def _header(rows: Rows) -> int | None:
    """Return the place of the row that names the columns, None without one."""
    for place, (_, line) in enumerate(rows.numbered[:_HEADER_ROWS]):
        separator = rows.separator(line)
        cells = rows.cells(line, separator)
        if are_numbers(cells):
            return None
        if separator is None and not _heads_numbers(rows, place, len(cells)):  # prose has blanks too
            continue
        quantities = [column_of(cell).quantity for cell in cells]
        axis, signal = {"time", "period"} & set(quantities), {"acceleration", "spectrum"} & set(quantities)
        if axis and signal and len(cells) > 1:
            return place
    return None


def _heads_numbers(rows: Rows, place: int, width: int) -> bool:
    """Tell whether a row, or the one below it, stands over as many numbers as it has cells."""
    below = [rows.cells(line, None) for _, line in rows.numbered[place + 1 : place + 3]]
    return any(len(cells) == width and are_numbers(cells) for cells in below)


def _channels(file: RecordFile) -> list[Channel]:
    rows = Rows(file)
    place = _header(rows)
    if place is None:
        place = 0
    if len(rows.numbered) < place + 3:
        found = len(rows.numbered) - place
        required = f"a header as {_EXAMPLE} and two rows of numbers are required"
        raise file.error(len(file.lines), f"{found} rows; {required}")
    header_line, header = rows.numbered[place]
    separator = rows.separator(header)
    names = rows.cells(header, separator)
    body = rows.numbered[place + 1 :]
    units = rows.cells(body[0][1], separator)
    if len(units) == len(names) and not any(are_numbers([unit]) for unit in units):
        body = body[1:]
    else:
        units = [""] * len(names)
    columns = [column_of(name, unit) for name, unit in zip(names, units, strict=True)]
    time, accelerations = _chosen(file, header_line, columns)

    line_numbers, table = [], []
    for line_number, line in body:
        cells = rows.cells(line, separator)
        if len(cells) != len(columns):
            raise file.error(line_number, f"{len(cells)} cells in {quoted(line)}; the header has {len(columns)}")
        line_numbers.append(line_number)
        table.append([rows.number(line_number, cells[i], separator) for i in (time, *accelerations)])
    if len(table) < 2:
        raise file.error(len(file.lines), f"{len(table)} rows of numbers; two or more are required")
    file.check_last_number(body[0][0])
    values = np.array(table)
    time_step = step_of_times(file, line_numbers, values[:, 0] * (columns[time].factor or 1.0))
    for column in values.T[1:]:
        file.check_marks(column, line_numbers)
    several = len(accelerations) > 1
    return [
        Channel(
            (columns[i].component or columns[i].name) if several else "",
            time_step,
            values[:, place],
            columns[i].factor,
            alias=columns[i].name if several else "",
        )
        for place, i in enumerate(accelerations, 1)
    ]


def _chosen(file: RecordFile, line_number: int, columns: list[Column]) -> tuple[int, list[int]]:
    """Return the index of the time column and those of the columns of acceleration, all of them with a unit."""
    of = {
        quantity: [i for i, column in enumerate(columns) if column.quantity == quantity]
        for quantity in ("time", "acceleration", "period", "spectrum")
    }
    names = quoted(",".join(column.name for column in columns))
    for quantity, found in (("period", "a period"), ("spectrum", "a spectrum")):
        if of[quantity] and not (quantity == "period" and of["time"]):
            name = quoted(columns[of[quantity][0]].name)
            problem = f"column {name} is {found}, so that {names} is a response spectrum"
            raise file.error(line_number, f"{problem}; accelerations in time are required, as in {_EXAMPLE}")
    if len(of["time"]) != 1 or not of["acceleration"]:
        kind = "acceleration" if len(of["time"]) == 1 else "time"
        other = next((column for column in columns if column.quantity in ("velocity", "displacement")), None)
        it_is = f" ({quoted(other.name)} is a {other.quantity})" if other and kind == "acceleration" else ""
        problem = f"{len(of[kind])} {kind} columns in {names}{it_is}"
        raise file.error(line_number, f"{problem}; one is required, as in {_EXAMPLE}")
    time = columns[of["time"][0]]
    if time.factor is None:
        raise file.error(line_number, f"no unit s in column {quoted(time.name)}; 'time_s' is required")
    for i in of["acceleration"]:
        if columns[i].factor is None:
            problem = f"no unit of acceleration in column {quoted(columns[i].name)}"
            raise file.error(line_number, f"{problem}; {UNITS_READ} is required")
    return of["time"][0], of["acceleration"]


CSV = RecordFormat("CSV", (".csv",), _recognises, _channels)
