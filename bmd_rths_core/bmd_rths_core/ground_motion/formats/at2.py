"""Reader of PEER AT2 files, in all the variants of header that are in circulation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import (
    UNITS_READ,
    factor_on_unit,
    listed,
    named_quantity,
    other_quantity,
    quoted,
    unit_factor,
)
from bmd_rths_core.ground_motion.motion import GroundMotion

_SIZE_LINE = re.compile(r"\bNPTS\b", re.IGNORECASE)
# "NPTS=  4000, DT= .01000 SEC", also without comma, without SEC, in lower case and with text after it
_KEYWORDS_FIRST = re.compile(
    r"NPTS\s*=\s*([0-9]{1,9})(?!\.?[0-9]).*?\bDT\s*=\s*([0-9.ED+-]+(?:,[0-9]+)?)\s*([A-Z]*)", re.IGNORECASE
)
# "7200    0.0050    NPTS, DT"
_VALUES_FIRST = re.compile(r"\s*([0-9]{1,9})[\s,]+([0-9.ED+-]+)()[\s,]+NPTS\s*,?\s*DT\b", re.IGNORECASE)
#: Lines in which the one with NPTS and DT is looked for when a file is recognised.
_HEADER_LINES = 100
_TIME_UNITS = ("", "S", "SEC", "SECS", "SECOND", "SECONDS")
# "UNITS OF G", "The units are (g)", "UNITS: cm/s²", but not "UNIT 2" of a power station
# "Acceleration in g", "ACC. (cm/s2)", "Accel [g]"
_UNIT = re.compile(
    r"\b(?:units?\s*(?:\b(?:of|are|is|in)\b|[:=(\[])|acc[a-z]*\.?\s*(?:time\s+(?:series|history)\s*)?"
    r"(?:\bin\b|[(\[])(?!\s*units?\b))"
    r"[\s(\[:=]*([^\s(),;:=\[\]]+)(?=(.*))",
    re.IGNORECASE,
)
_UNCORRECTED = re.compile(r"\b(?:un-?corrected|un-?processed)\b", re.IGNORECASE)


def read_at2(path: str | Path) -> GroundMotion:
    """Read a PEER AT2 file (NGA-West2, NGA-1, the older PEER database, and files edited by hand from these).

    The header ends with the line that names NPTS and DT and must name the unit somewhere above it. The values follow in
    any number of columns, up to the end of the file or a line ``*** End Data ***``.

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
        The file cannot be read; the header has no NPTS, DT or unit; a value is not a finite number; or there are more
        or fewer values than NPTS.
    """
    return AT2.read(path)


def _recognises(file: RecordFile) -> bool:
    return file.is_text and any(
        _KEYWORDS_FIRST.match(line.lstrip()) or _VALUES_FIRST.match(line) for line in file.lines[:_HEADER_LINES]
    )


def _channels(file: RecordFile) -> list[Channel]:
    size_line = next((n for n, line in enumerate(file.lines, 1) if _SIZE_LINE.search(line)), None)
    if size_line is None:
        raise InputError(f"{file.path}: no header line with NPTS and DT, as 'NPTS=  4000, DT= .0100 SEC'")
    steps, time_step = _size(file, size_line)
    _check_quantity(file, size_line)
    factor = _factor(file, size_line)
    values = file.numbers(size_line + 1, end="*** end")
    if len(values) != steps:
        raise InputError(f"{file.path}: {len(values)} values, but line {size_line} gives NPTS = {steps}")
    return [Channel("", time_step, np.array(values), factor)]


def _check_quantity(file: RecordFile, size_line: int) -> None:
    """Check that no line of the header says that the values are something else than a corrected acceleration."""
    for line_number, line in enumerate(file.lines[:size_line], 1):
        if quantity := named_quantity(line):
            raise file.error(line_number, f"a {quantity}, by {quoted(line)}; an acceleration is required")
        if _UNCORRECTED.search(line):
            raise file.error(line_number, f"an uncorrected record, by {quoted(line)}; a corrected one is required")


def _size(file: RecordFile, line_number: int) -> tuple[int, float]:
    """Return the number of points and the time step [s]."""
    line = file.lines[line_number - 1]
    found = _KEYWORDS_FIRST.search(line) or _VALUES_FIRST.match(line)
    if found is None:
        raise file.error(line_number, f"no NPTS and DT in {quoted(line)}; 'NPTS=  4000, DT= .0100 SEC' is required")
    steps, time_step, unit = found.groups()
    if unit.upper() not in _TIME_UNITS:
        raise file.error(line_number, f"DT in {quoted(unit)}; SEC is required")
    return int(steps), file.number(line_number, time_step)


def _factor(file: RecordFile, size_line: int) -> float:
    """Return the unit of the values in m/s², which the header must name: a guess could be wrong by 9.8."""
    found_units = [
        (line_number, str(found[1]), str(found[2]))
        for line_number, line in enumerate(file.lines[:size_line], 1)
        for found in _UNIT.finditer(line)
    ]
    for line_number, name, rest in found_units:
        if factor_on_unit(name, rest):
            problem = f"a factor on the unit, {quoted(name + rest)}; values in the unit itself are required"
            raise file.error(line_number, problem)
        if quantity := other_quantity(name.rstrip(".")):
            raise file.error(line_number, f"a {quantity}, in {quoted(name)}; an acceleration is required")
    names = [name.rstrip(".") for _, name, _ in found_units]
    factors = {unit_factor(name) for name in names}
    factor = factors.pop() if len(factors) == 1 else None
    if factor is None:
        found = f"names {listed(names)} as unit" if names else "names no unit"
        raise InputError(f"{file.path}: the header {found}; a line 'UNITS OF G' is required ({UNITS_READ})")
    return factor


AT2 = RecordFormat("PEER AT2", (".at2",), _recognises, _channels)
