"""Reader of ASCII files of the Central Weather Administration (formerly Bureau), Taiwan."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bmd_rths_core.ground_motion.formats.header import Header
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

# "#SampleRate(Hz): 50", and empty lines between the parts of the header
_ENTRY = re.compile(r"(?=#|\s*$)#?([^:]*):?(.*)")
# "Time U(+); N(+); E(+)": the sign says which sense is positive
_SEQUENCE = re.compile(r"Time\s+(\w+)\(\+\);\s*(\w+)\(\+\);\s*(\w+)\(\+\)", re.IGNORECASE)
# Half of the last of three decimals of the time column, and rounding
_TIME_TOLERANCE = 0.501e-3


def read_cwa(path: str | Path, component: str) -> GroundMotion:
    """Read a CWA file: a column of time and three of acceleration, in the unit and the order its header states.

    The offset is kept as it is in the file, where the header says whether it has been removed ("DCoffset(corr)").
    (Format: header of the files of the Taiwan Strong Motion Instrumentation Program.)

    Parameters
    ----------
    path : str or Path
        The file.
    component : str
        ``"U"``, ``"N"`` or ``"E"``.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read, it has no such component, a line of the header or of the values is wrong, a time is
        not that of the sample rate, or there are more or fewer rows than record length times sample rate.
    """
    return CWA.read(path, component, FROM_FILE)


def _recognises(file: RecordFile) -> bool:
    return file.begins_with("#earthquake information", "#datasequence")


def _channels(file: RecordFile) -> list[Channel]:
    header = Header(file, _ENTRY)
    rate = header.positive("SampleRate(Hz)")
    unit = header.unit("AmplitudeUnit")
    line_number, sequence = header.text("DataSequence")
    names = _SEQUENCE.fullmatch(sequence)
    if names is None:
        raise file.error(line_number, f"columns {quoted(sequence)}; 'Time U(+); N(+); E(+)' is required")
    rows = file.table(header.first_line_behind, columns=4)
    file.check_count(len(rows), round(header.positive("RecordLength(sec)") * rate, 6), "length times sample rate is")
    wrong = np.flatnonzero(np.abs(rows[:, 0] - np.arange(len(rows)) / rate) > _TIME_TOLERANCE)
    if wrong.size:
        row = int(wrong[0])
        problem = f"time {rows[row, 0]:g} s; {row / rate:g} s is required by the sample rate"
        raise file.error(header.first_line_behind + row, problem)
    return [Channel(name, 1.0 / rate, rows[:, i], unit) for i, name in enumerate(names.groups(), 1)]


CWA = RecordFormat("CWA", (), _recognises, _channels)
