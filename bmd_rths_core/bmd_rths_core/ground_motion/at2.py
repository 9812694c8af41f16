"""Reader of PEER AT2 files, in all the variants of header that are in circulation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.ground_motion.parsing import UNITS_READ, TextFile, quoted, read_text, unit_factor

_SIZE_LINE = re.compile(r"\bNPTS\b", re.IGNORECASE)
# "NPTS=  4000, DT= .01000 SEC", also without comma, without SEC, in lower case and with text after it
_KEYWORDS_FIRST = re.compile(
    r"NPTS\s*=\s*([0-9]{1,9})(?!\.?[0-9]).*?\bDT\s*=\s*([0-9.ED+-]+)\s*([A-Z]*)", re.IGNORECASE
)
# "7200    0.0050    NPTS, DT"
_VALUES_FIRST = re.compile(r"\s*([0-9]{1,9})[\s,]+([0-9.ED+-]+)()[\s,]+NPTS\s*,?\s*DT\b", re.IGNORECASE)
_TIME_UNITS = ("", "S", "SEC", "SECS", "SECOND", "SECONDS")
# "UNITS OF G", "The units are (g)", "UNITS: cm/s²", but not "UNIT 2" of a power station
_UNIT = re.compile(r"\bunits?\s*(?:\b(?:of|are|is|in)\b|[:=(])[\s(:=]*([^\s(),;:=]+)", re.IGNORECASE)
# Fixed-width columns that are full run together: a sign after a digit begins the next number.
_SEPARATOR = re.compile(r"[\s,]+|(?<=[0-9.])(?=[+-])")


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
    file = read_text(path)
    size_line = next((n for n, line in enumerate(file.lines, 1) if _SIZE_LINE.search(line)), None)
    if size_line is None:
        raise InputError(f"{path}: no header line with NPTS and DT, as 'NPTS=  4000, DT= .0100 SEC'")
    steps, time_step = _size(file, size_line)
    factor = _factor(file, size_line)
    values = _values(file, size_line)
    if len(values) != steps:
        raise InputError(f"{path}: {len(values)} values, but line {size_line} gives NPTS = {steps}")
    return GroundMotion(file.path.stem, time_step, np.array(values) * factor, str(path), file.sha256)


def _size(file: TextFile, line_number: int) -> tuple[int, float]:
    """Return the number of points and the time step [s]."""
    line = file.lines[line_number - 1]
    found = _KEYWORDS_FIRST.search(line) or _VALUES_FIRST.match(line)
    if found is None:
        raise file.error(line_number, f"no NPTS and DT in {quoted(line)}; 'NPTS=  4000, DT= .0100 SEC' is required")
    steps, time_step, unit = found.groups()
    if unit.upper() not in _TIME_UNITS:
        raise file.error(line_number, f"DT in {quoted(unit)}; SEC is required")
    return int(steps), file.number(line_number, time_step)


def _factor(file: TextFile, size_line: int) -> float:
    """Return the unit of the values in m/s², which the header must name: a guess could be wrong by 9.8."""
    names = [name.rstrip(".") for line in file.lines[:size_line] for name in _UNIT.findall(line)]
    factors = {unit_factor(name) for name in names}
    factor = factors.pop() if len(factors) == 1 else None
    if factor is None:
        found = f"names {', '.join(quoted(name) for name in names)} as unit" if names else "names no unit"
        raise InputError(f"{file.path}: the header {found}; a line 'UNITS OF G' is required ({UNITS_READ})")
    return factor


def _values(file: TextFile, size_line: int) -> list[float]:
    values = []
    for line_number, line in enumerate(file.lines[size_line:], size_line + 1):
        if line.lower().startswith("*** end"):
            break
        values += [file.number(line_number, text) for text in _SEPARATOR.split(line) if text]
    return values
