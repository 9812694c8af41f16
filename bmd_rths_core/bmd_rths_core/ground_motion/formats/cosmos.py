"""Reader of COSMOS strong-motion files, version 1.20, of corrected acceleration (V2, V2c)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import ONLY
from bmd_rths_core.ground_motion.formats.units import named_quantity, quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

_FORMAT = r"format\s*=\s*\(\s*([0-9]{1,2})[FEG]([0-9]{1,2})\.[0-9]+\)"
# " 100 Real-header values follow on  20 lines, Format= (5F15.6)"
_REAL_HEADER = re.compile(r"\s*([0-9]{1,4})\s+real-header values.*" + _FORMAT, re.IGNORECASE)
# "   42000 acceleration pts, approx  210 secs, units=cm/sec2(04),Format=(1E15.6)"
_DATA_LINE = re.compile(
    r"\s*([0-9]{1,9})\s+(\S{1,40})\s+pts\b.*\bunits\s*=\s*([^,]{1,40}),\s*" + _FORMAT, re.IGNORECASE
)
# "Sta Chan   1: 360 deg   (Rcrdr Chan  1) Location:Ground"
_DIRECTION = re.compile(r"Sta Chan\s+\S{1,9}:\s*([^(]{1,20})", re.IGNORECASE)
# "|<SCNL>BMR.BNZ.AK.--": station, channel, network, location
_SCNL = re.compile(r"\|\s*<SCNL>[^.]*\.([^.\s]+)\.", re.IGNORECASE)
# "Values used when parameter or data value is unknown/unspecified:   -999, -999.00"
_MARKS = re.compile(r".*value is unknown/unspecified:\s*([^\s,]{1,20})[\s,]+([^\s,]{1,20})", re.IGNORECASE)
_END = "End-of-data"

#: Place of the time step of the values, in ms, among the real numbers of the header; the recorder's own is another.
_TIME_STEP = 62


def read_cosmos(path: str | Path, component: str = ONLY) -> GroundMotion:
    """Read a COSMOS V2 file: one or several components of corrected acceleration.

    The accelerations are taken as they are. (COSMOS Strong Motion Data Format, version 1.20, 2001;
    strongmotion.org.)

    Parameters
    ----------
    path : str or Path
        The file.
    component : str
        Its SEED channel code in the comment ``<SCNL>``, for example ``"HNE"``, or without that its direction in the
        line ``Sta Chan``, for example ``"360 deg"``; ``"only"`` where the file has one.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read, it has no such component, it is no corrected acceleration, a line is wrong, or a
        component is cut off.
    """
    return COSMOS.read(path, component)


def _recognises(file: RecordFile) -> bool:
    return re.match(r"[^\n]*\(format v[0-9.]+ with [0-9]+ text lines\)", file.head) is not None


def _channels(file: RecordFile) -> list[Channel]:
    title = file.lines[file.first_line - 1].strip()
    if not title.lower().startswith("corrected acceleration"):
        word = title.split()[1].lower() if len(title.split()) > 1 else ""
        known = "an uncorrected record, " if re.match("uncorrected|raw", title, re.IGNORECASE) else ""
        known = known or (f"a {named_quantity(word)}, " if named_quantity(word) else "")
        raise file.error(file.first_line, f"{known}{quoted(title)}; 'Corrected acceleration' is required")
    channels = []
    found: re.Match[str] | None
    name, time_step = "", 0.0
    marks: tuple[float, ...] = ()
    line_number = file.first_line
    while line_number <= len(file.lines):
        line = file.lines[line_number - 1]
        if found := _SCNL.match(line) or _DIRECTION.match(line):
            name = found[1].strip()
        elif found := _MARKS.match(line):
            marks = tuple(file.number(line_number, mark.rstrip(".")) for mark in found.group(1, 2))
        elif found := _REAL_HEADER.match(line):
            time_step = _time_step(file, line_number, found)
        elif found := _DATA_LINE.match(line):
            first_line = line_number + 1
            channel, line_number = _channel(file, line_number, name, time_step, found)
            _check_marks(file, channel, marks, first_line, int(found[4]))
            channels.append(channel)
            name, time_step = "", 0.0
        line_number += 1
    if not channels:
        raise InputError(f"{file.path}: no line '42000 acceleration pts, ..., units=cm/sec2, Format=(1E15.6)'")
    if not _is_end(file.lines[-1]):
        raise file.error(len(file.lines), f"the file is cut off: {_END!r} is required in its last line")
    return channels


def _time_step(file: RecordFile, line_number: int, found: re.Match[str]) -> float:
    count, columns, width = (int(text) for text in found.groups())
    if count < _TIME_STEP or not (columns and width):
        raise file.error(line_number, f"{quoted(found[0])}; {_TIME_STEP} or more numbers are required")
    return float(file.fixed_width(line_number + 1, count, columns, width, header=True)[_TIME_STEP - 1]) / 1000.0


def _channel(
    file: RecordFile, line_number: int, name: str, time_step: float, found: re.Match[str]
) -> tuple[Channel, int]:
    """Return a component and the number of its last line."""
    quantity, unit = found[2], found[3]
    points, columns, width = (int(text) for text in found.group(1, 4, 5))
    if other := named_quantity(quantity):
        raise file.error(line_number, f"a {other}, {quoted(found[0])}; acceleration pts are required")
    if quantity.lower() != "acceleration" or not (columns and width):
        raise file.error(line_number, f"{quoted(found[0])}; acceleration pts are required")
    if time_step <= 0.0:
        raise file.error(line_number, f"time step {time_step:g} s in the header above; a number > 0 is required")
    values = file.fixed_width(line_number + 1, points, columns, width)
    end = line_number + 1 + -(-points // columns)
    if end > len(file.lines) or not _is_end(file.lines[end - 1]):
        raise file.error(min(end, len(file.lines)), f"{_END!r} is required behind the {points} values")
    return Channel(name, time_step, values, file.unit(line_number, unit)), end


def _check_marks(file: RecordFile, channel: Channel, marks: tuple[float, ...], first_line: int, columns: int) -> None:
    """Check that no value is one of the marks the header declares for unknown ones."""
    missing = np.flatnonzero(np.isin(channel.values, marks))
    if missing.size:
        problem = f"{channel.values[missing[0]]:g} is the mark of an unknown value, as the header declares it"
        raise file.error(first_line + int(missing[0]) // columns, problem)


def _is_end(line: str) -> bool:
    return line.lower().startswith(_END.lower())


COSMOS = RecordFormat("COSMOS V2", (".v2c",), _recognises, _channels)
