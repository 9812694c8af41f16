"""Reader of GeoNet V2A files, New Zealand."""

from __future__ import annotations

import math
import re
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE
from bmd_rths_core.ground_motion.formats.units import factor_on_unit
from bmd_rths_core.ground_motion.motion import GroundMotion

_TEXT_LINES = 16
# Ten lines of numbers behind the text: four of integers and six of real numbers, ten of 8 characters in each
_NUMBER_LINES = 10
_COLUMNS = 10
_WIDTH = 8
_COMPONENT = re.compile(r"Component\s+(\S+)", re.IGNORECASE)
_UNIT = re.compile(r"Acceleration:\s+peak\s+\S+\s+mm/s/s\b(.*)", re.IGNORECASE)


def read_geonet(path: str | Path, component: str) -> GroundMotion:
    """Read a GeoNet V2A file: usually three components, each with acceleration, velocity and displacement in mm and s.

    The accelerations are taken as they are, instrument corrected and filtered by GeoNet. (GeoNet, "Strong motion file
    formats", geonet.org.nz/data/supplementary/strong_motion_file_formats.)

    Parameters
    ----------
    path : str or Path
        The file.
    component : str
        As its line ``Component`` has it, for example ``"S16W"`` or ``"Up"``.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read, it has no such component, a line is wrong, or a component is cut off.
    """
    return GEONET.read(path, component, FROM_FILE)


def _recognises(file: RecordFile) -> bool:
    return file.begins_with("corrected accelerogram", "component")


def _channels(file: RecordFile) -> list[Channel]:
    channels = []
    line_number = file.first_line
    while line_number <= len(file.lines):
        channel, line_number = _channel(file, line_number)
        channels.append(channel)
    return channels


def _channel(file: RecordFile, first_line: int) -> tuple[Channel, int]:
    """Return a component and the number of the line behind it."""
    text = file.lines[first_line - 1 : first_line - 1 + _TEXT_LINES]
    if not text[0].lower().startswith("corrected accelerogram"):
        raise file.error(first_line, "'Corrected accelerogram' is required, the first line of a component")
    names = [found[1] for line in text if (found := _COMPONENT.match(line))]
    if len(names) != 1:
        raise file.error(
            first_line, f"{len(names)} lines 'Component ...' in {_TEXT_LINES} lines of text; 1 is required"
        )
    units = [found[1] for line in text if (found := _UNIT.match(line))]
    if any(factor_on_unit("mm/s/s", rest) for rest in units):
        raise file.error(first_line, "a factor on the unit mm/s/s; values in the unit itself are required")
    if not units:
        raise file.error(first_line, f"no line 'Acceleration: peak ... mm/s/s' in {_TEXT_LINES} lines of text")

    numbers_line = first_line + _TEXT_LINES
    header = file.fixed_width(numbers_line, _NUMBER_LINES * _COLUMNS, _COLUMNS, _WIDTH, header=True)
    header = header.reshape(_NUMBER_LINES, _COLUMNS)
    points, time_step = [int(count) for count in header[3, 3:6]], float(header[6, 5])
    if min(points) < 0 or points[0] < 2:
        counts = "acceleration, velocity and displacement"
        raise file.error(numbers_line + 3, f"{points} points of {counts}; two or more of acceleration are required")
    values_line = numbers_line + _NUMBER_LINES
    values = file.fixed_width(values_line, points[0], _COLUMNS, _WIDTH)
    behind = values_line + sum(math.ceil(count / _COLUMNS) for count in points)
    if behind > len(file.lines) + 1:
        raise InputError(f"{file.path}: cut off after line {len(file.lines)}; {names[0]} goes on to line {behind - 1}")
    return Channel(names[0], time_step, values, 1e-3), behind


GEONET = RecordFormat("GeoNet V2A", (".v2a",), _recognises, _channels)
