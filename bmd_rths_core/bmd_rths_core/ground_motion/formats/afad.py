"""Reader of the old text files of AFAD, Türkiye: three raw components in gal."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

_TITLE = "strong ground motion records of turk"
_NAMES = {"N-S", "E-W", "U-D"}
# "RAW PGA VALUES (gal)"
_UNIT = re.compile(r"\(\s*([^)]*?)\s*\)")
#: The line of names is looked for in so many lines.
_LONGEST_HEADER = 60


def read_afad(path: str | Path) -> GroundMotion:
    """Read an old AFAD text file: a header of keys, the names of three components, and a column for each.

    The values are raw; a record without a high-pass is refused. (AFAD, National Strong-Motion Network of Türkiye, files
    before those of TADAS, which are in the format of ESM.)

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
        The file cannot be read, a line of the header or of the values is wrong, or there are more or fewer rows than
        the header says.
    """
    return AFAD.read(path)


def _recognises(file: RecordFile) -> bool:
    return file.begins_with(_TITLE)


def _channels(file: RecordFile) -> list[Channel]:
    entries: dict[str, tuple[int, str]] = {}
    for names_line, line in enumerate(file.lines[:_LONGEST_HEADER], 1):
        names = line.upper().split()
        if len(names) == len(_NAMES) and set(names) == _NAMES:
            break
        key, _, value = line.partition(":")
        entries.setdefault(" ".join(key.upper().split()), (names_line, value.strip()))
    else:
        raise InputError(f"{file.path}: no line with the names N-S, E-W and U-D of the columns")
    points, time_step, peaks = (
        _key(file, entries, name) for name in ("NUMBER OF DATA", "SAMPLING INTERVAL", "RAW PGA")
    )
    values = file.table(names_line + 1, len(names))
    file.check_count(len(values), _positive(file, *entries[points]), "NUMBER OF DATA is")
    line_number = entries[peaks][0]
    found = _UNIT.search(file.lines[line_number - 1])
    unit = file.unit(line_number, found[1]) if found else None
    raw = f"line {line_number}: {quoted(file.lines[line_number - 1].strip())}"
    step = _positive(file, *entries[time_step])
    return [Channel(name, step, values[:, i], unit, uncorrected=raw) for i, name in enumerate(names)]


def _key(file: RecordFile, entries: Mapping[str, object], beginning: str) -> str:
    """Return the whole key that begins so; units stand behind some."""
    found = next((key for key in entries if key.startswith(beginning)), None)
    if found is None:
        raise InputError(f"{file.path}: no header line {beginning!r} before the names of the columns")
    return found


def _positive(file: RecordFile, line_number: int, text: str) -> float:
    value = file.number(line_number, text)
    if value <= 0.0:
        raise file.error(line_number, f"{quoted(text)}; a number > 0 is required")
    return value


AFAD = RecordFormat("AFAD", (), _recognises, _channels)
