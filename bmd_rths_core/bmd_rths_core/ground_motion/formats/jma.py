"""Reader of CSV files of the Japan Meteorological Agency."""

from __future__ import annotations

import re
from pathlib import Path

from bmd_rths_core.ground_motion.formats.header import Header
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

# " SAMPLING RATE= 100Hz"
_ENTRY = re.compile(r"\s*([A-Za-z][A-Za-z. ]*)=(.*)")


def read_jma(path: str | Path, component: str) -> GroundMotion:
    """Read a strong-motion CSV file of the JMA: columns of acceleration with rate and unit in the header.

    Nothing is corrected. (JMA, data.jma.go.jp/eqev/data/kyoshin.)

    Parameters
    ----------
    path : str or Path
        The file.
    component : str
        ``"NS"``, ``"EW"`` or ``"UD"``.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The file cannot be read, it has no such component, or a line of the header or of the values is wrong.
    """
    return JMA.read(path, component, FROM_FILE)


def _recognises(file: RecordFile) -> bool:
    return file.begins_with("site code", "sampling rate")


def _channels(file: RecordFile) -> list[Channel]:
    header = Header(file, _ENTRY)
    time_step = 1.0 / header.positive("SAMPLING RATE", unit="Hz")
    unit = header.unit("UNIT")
    line_number = header.first_line_behind
    line = file.lines[line_number - 1] if line_number <= len(file.lines) else ""
    names = [name.strip() for name in line.split(",")]
    if not all(re.fullmatch("[A-Za-z]+", name) for name in names):
        raise file.error(line_number, f"columns {quoted(line)}; 'NS,EW,UD' is required")
    rows = file.table(line_number + 1, columns=len(names), separator=",")
    return [Channel(name, time_step, rows[:, i], unit) for i, name in enumerate(names)]


JMA = RecordFormat("JMA CSV", (), _recognises, _channels)
