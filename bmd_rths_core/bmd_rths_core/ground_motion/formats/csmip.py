"""Reader of V2 files of the California Strong Motion Instrumentation Program (CSMIP, formerly CDMG)."""

from __future__ import annotations

import re
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

# " 3251 POINTS OF ACCEL DATA EQUALLY SPACED AT  .020 SEC.  (UNITS: CM/SEC/SEC)" in 8F10.3, or later
# "15200 points of accel data equally spaced at  .005 sec, in cm/sec2. (8f10.6)"
_DATA_LINE = re.compile(
    r"\s*([0-9]{1,9})\s+points of accel data equally spaced at"
    r"\s+([0-9.]+)\s*sec[.,]?\s*(?:\(units:|in)\s*([^\s)]+)([^)]*)",
    re.IGNORECASE,
)
_COLUMNS = 8
_WIDTH = 10
# "CHAN  1:  90 DEG"; the last such line above the data has nothing behind the direction
_CHANNEL = re.compile(r"\bchan\s+[0-9]{1,4}:\s*(\S.*)", re.IGNORECASE)
# The first line of a channel; that of the uncorrected one it was made from may follow below
_TITLE = re.compile(r"\s*(un-?)?corrected accelerogram", re.IGNORECASE)
_END = re.compile(r"/&.*\bend of data for channel\b", re.IGNORECASE)


def read_csmip(path: str | Path, component: str) -> GroundMotion:
    """Read a CSMIP or CDMG V2 file: several channels, each with acceleration, velocity and displacement.

    The accelerations are taken as they are, instrument and baseline corrected by CSMIP. (Shakal and Ragsdale 1984,
    CDMG Office of Strong Motion Studies, report OSMS 84-3; strongmotioncenter.org.)

    Parameters
    ----------
    path : str or Path
        The file.
    component : str
        Direction of the channel as its line ``CHAN`` has it, for example ``"90 DEG"`` or ``"UP"``; where several
        channels have one direction, with their place in the file: ``"90 DEG (4)"``.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read, it has no such channel, a line is wrong, or a channel is cut off.
    """
    return CSMIP.read(path, component, FROM_FILE)


def _recognises(file: RecordFile) -> bool:
    return file.is_text and any(_DATA_LINE.match(line) for line in file.lines[:200])


def _channels(file: RecordFile) -> list[Channel]:
    channels = []
    name = ""
    last_title, last_data_line, last_end = 0, 0, 0
    for line_number, line in enumerate(file.lines, 1):
        if (found := _TITLE.match(line)) and last_title <= last_end:
            last_title = line_number
            if found[1]:
                raise file.error(line_number, f"an uncorrected record, by {quoted(line)}; a V2 file is corrected")
        if found := _CHANNEL.search(line):
            name = " ".join(found[1].split())
        elif found := _DATA_LINE.match(line):
            if last_end < last_data_line:
                problem = "the channel is cut off: 'END OF DATA FOR CHANNEL' is required behind it"
                raise file.error(last_data_line, problem)
            channels.append(_channel(file, line_number, name, found))
            last_data_line = line_number
        elif _END.match(line):
            last_end = line_number
    if not channels:
        raise InputError(f"{file.path}: no line 'POINTS OF ACCEL DATA EQUALLY SPACED AT'; a V2 file has one")
    if last_end < len(file.lines):
        raise file.error(len(file.lines), "the file is cut off: 'END OF DATA FOR CHANNEL' is required in its last line")
    return channels


def _channel(file: RecordFile, line_number: int, name: str, data_line: re.Match[str]) -> Channel:
    if not name:
        raise file.error(line_number, "no line 'CHAN  1:  90 DEG' above the values")
    points, time_step, unit, rest = data_line.groups()
    factor = file.unit(line_number, f"{unit} {rest}")
    values = file.fixed_width(line_number + 1, int(points), _COLUMNS, _WIDTH)
    return Channel(name, file.number(line_number, time_step), values, factor)


CSMIP = RecordFormat("CSMIP V2", (".v2",), _recognises, _channels)
