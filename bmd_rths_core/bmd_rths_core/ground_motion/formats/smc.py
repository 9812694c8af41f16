"""Reader of SMC files of the U.S. Geological Survey."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

_TITLE = re.compile(
    r"\s*([0-9])\s+(uncorrected accelerogram|corrected accelerogram|velocity|displacement|.{0,40}spectr.{0,40})",
    re.IGNORECASE,
)
_TEXT_LINES, _INTEGER_LINES, _REAL_LINES = 11, 6, 10
# Places, from 0, of what is needed among the integers and the reals of the header
_COMMENTS, _POINTS, _UNKNOWN, _RATE = 15, 16, 0, 1
_COLUMNS, _WIDTH = 8, 10


def read_smc(path: str | Path) -> GroundMotion:
    """Read an SMC file of corrected acceleration: one component in cm/s².

    Eleven lines of text, 48 integers in 8I10, 50 real numbers in 5E15.7, comments that begin with ``|``, and the values
    in 8F10.4 or 8E10.4. (USGS, National Strong-Motion Program, SMC-format data files.)

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
        The file cannot be read, it holds anything but corrected accelerations, or it is cut off.
    """
    return SMC.read(path)


def _recognises(file: RecordFile) -> bool:
    return file.is_text and _TITLE.fullmatch(file.lines[file.first_line - 1].rstrip()) is not None


def _channels(file: RecordFile) -> list[Channel]:
    first = file.first_line
    found = _TITLE.match(file.lines[first - 1])
    kind = found[2].lower().strip() if found else ""
    if kind != "corrected accelerogram":
        article = "an" if kind.startswith("un") else "a"
        name = "uncorrected record" if kind.startswith("un") else "spectrum" if "spectr" in kind else kind or "file"
        raise file.error(first, f"{article} {name}, by {quoted(file.lines[first - 1])}; a corrected one is required")
    integers_line = first + _TEXT_LINES
    integers = file.fixed_width(integers_line, 8 * _INTEGER_LINES, 8, 10, header=True)
    reals_line = integers_line + _INTEGER_LINES
    reals = file.fixed_width(reals_line, 5 * _REAL_LINES, 5, 15, header=True)
    comments, points, rate = int(integers[_COMMENTS]), int(integers[_POINTS]), float(reals[_RATE])
    if not (0 <= comments < len(file.lines) and points > 0 and 0.0 < rate < 1e5):
        problem = f"{points} points at {rate:g} Hz behind {comments} comments; numbers > 0 are required"
        raise file.error(integers_line, problem)
    values_line = reals_line + _REAL_LINES + comments
    values = file.fixed_width(values_line, points, _COLUMNS, _WIDTH)
    unknown = np.flatnonzero(values == reals[_UNKNOWN])
    if unknown.size:
        problem = f"{values[unknown[0]]:g} is the mark of an unknown value, as the header declares it"
        raise file.error(values_line + int(unknown[0]) // _COLUMNS, problem)
    behind = values_line + -(-points // _COLUMNS)
    if len(file.lines) >= behind:
        raise InputError(f"{file.path}: line {behind}: more lines than {points} points need")
    return [Channel("", 1.0 / rate, values, 0.01)]


SMC = RecordFormat("USGS SMC", (".smc",), _recognises, _channels)
