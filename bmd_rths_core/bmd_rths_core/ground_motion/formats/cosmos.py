"""Reader of COSMOS strong-motion files, version 1.20, of corrected acceleration (V2, V2c)."""

from __future__ import annotations

import re
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import ONLY, Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import quoted
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
_SCNL = re.compile(r"\|\s*<SCNL>[^.]*\.([^.\s]+)\.")
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
    first, _, _ = file.content.partition(b"\n")
    return re.search(rb"\(format v[0-9.]+ with [0-9]+ text lines\)", first, re.IGNORECASE) is not None


def _channels(file: RecordFile) -> list[Channel]:
    if not file.lines[0].lower().startswith("corrected acceleration"):
        raise file.error(1, f"{quoted(file.lines[0])}; 'Corrected acceleration' is required")
    channels = []
    name, time_step = "", 0.0
    line_number = 1
    while line_number <= len(file.lines):
        line = file.lines[line_number - 1]
        if found := _SCNL.match(line) or _DIRECTION.match(line):
            name = found[1].strip()
        elif found := _REAL_HEADER.match(line):
            time_step = _time_step(file, line_number, found)
        elif found := _DATA_LINE.match(line):
            channel, line_number = _channel(file, line_number, name, time_step, found)
            channels.append(channel)
            name, time_step = "", 0.0
        line_number += 1
    if not channels:
        raise InputError(f"{file.path}: no line '42000 acceleration pts, ..., units=cm/sec2, Format=(1E15.6)'")
    if not file.lines[-1].startswith(_END):
        raise file.error(len(file.lines), f"the file is cut off: {_END!r} is required in its last line")
    return channels


def _time_step(file: RecordFile, line_number: int, found: re.Match[str]) -> float:
    count, columns, width = (int(text) for text in found.groups())
    if count < _TIME_STEP or not (columns and width):
        raise file.error(line_number, f"{quoted(found[0])}; {_TIME_STEP} or more numbers are required")
    return float(file.fixed_width(line_number + 1, count, columns, width)[_TIME_STEP - 1]) / 1000.0


def _channel(
    file: RecordFile, line_number: int, name: str, time_step: float, found: re.Match[str]
) -> tuple[Channel, int]:
    """Return a component and the number of its last line."""
    quantity, unit = found[2], found[3]
    points, columns, width = (int(text) for text in found.group(1, 4, 5))
    if quantity.lower() != "acceleration" or not (columns and width):
        raise file.error(line_number, f"{quoted(found[0])}; acceleration pts are required")
    if time_step <= 0.0:
        raise file.error(line_number, f"time step {time_step:g} s in the header above; a number > 0 is required")
    values = file.fixed_width(line_number + 1, points, columns, width)
    end = line_number + 1 + -(-points // columns)
    if end > len(file.lines) or not file.lines[end - 1].startswith(_END):
        raise file.error(min(end, len(file.lines)), f"{_END!r} is required behind the {points} values")
    return Channel(name, time_step, values, file.unit(line_number, unit)), end


COSMOS = RecordFormat("COSMOS V2", (".v2c",), _recognises, _channels)
