"""Find a ground motion by name or by path."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.afad import AFAD
from bmd_rths_core.ground_motion.formats.archive import archive_format
from bmd_rths_core.ground_motion.formats.asdf import ASDF
from bmd_rths_core.ground_motion.formats.at2 import AT2
from bmd_rths_core.ground_motion.formats.cosmos import COSMOS
from bmd_rths_core.ground_motion.formats.csmip import CSMIP
from bmd_rths_core.ground_motion.formats.csv_columns import CSV
from bmd_rths_core.ground_motion.formats.cwa import CWA
from bmd_rths_core.ground_motion.formats.esm import ESM
from bmd_rths_core.ground_motion.formats.geonet import GEONET
from bmd_rths_core.ground_motion.formats.jma import JMA
from bmd_rths_core.ground_motion.formats.knet import KNET
from bmd_rths_core.ground_motion.formats.mat import MAT
from bmd_rths_core.ground_motion.formats.miniseed import MINISEED
from bmd_rths_core.ground_motion.formats.number_columns import NUMBERS
from bmd_rths_core.ground_motion.formats.record_file import RecordFile, read_file
from bmd_rths_core.ground_motion.formats.record_format import RecordFormat, choose
from bmd_rths_core.ground_motion.formats.sac import SAC
from bmd_rths_core.ground_motion.formats.simcenter import SIMCENTER
from bmd_rths_core.ground_motion.formats.smc import SMC
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE, ONLY, Stated
from bmd_rths_core.ground_motion.formats.units import named_quantity, quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

#: The formats that are read. A new one is a new module, and one entry here.
FORMATS: tuple[RecordFormat, ...] = (
    *(AT2, CSV, KNET, COSMOS, CSMIP, GEONET, ESM, CWA, JMA, SIMCENTER, MAT, SMC, SAC, MINISEED, AFAD, ASDF),
    NUMBERS,  # what no other one recognises
)

# Records in the public domain; each is data/<name>.csv in this package.
_SHIPPED = ("el_centro_1940_ns",)

# Lines in which a file that no format recognises may say what it is
_LINES = 30


def shipped_records() -> tuple[str, ...]:
    """Return the names of the records that come with this package."""
    return _SHIPPED


def read_ground_motion(
    reference: str | Path,
    component: str = ONLY,
    unit: str = FROM_FILE,
    *,
    time_step: float = 0.0,
    columns: str = FROM_FILE,
    high_pass: bool = False,
) -> GroundMotion:
    """Read a shipped record by its name, or a file by its path; the content of the file tells its format.

    Parameters
    ----------
    reference : str or Path
        One of `shipped_records`, or the path of a file in one of `FORMATS`.
    component : str
        Which component of a file with several, in either case of letters; ``"only"`` for a file with one.
    unit : str
        Unit of a file that states none: ``"g"``, ``"m/s2"``, ``"cm/s2"`` or ``"gal"``; ``"from_file"`` for all others.
    time_step : float
        Time step of a file that states none [s], 0 for all others.
    columns : str
        What the columns of a file of numbers are: ``"time"``, a component or ``"-"`` for each, with commas between, or
        ``"series"`` for one series over all lines.
    high_pass : bool
        The baseline is corrected afterwards, so that a record whose baseline is not may be read.

    Returns
    -------
    GroundMotion
        The record in m/s².

    Raises
    ------
    InputError
        The reference is neither, the file cannot be read or understood, or component or unit are missing or contradict
        it.
    """
    if str(reference) in _SHIPPED:
        data = resources.files("bmd_rths_core") / "data" / f"{reference}.csv"
        with resources.as_file(data) as path:
            file = read_file(path, Stated(component, unit, time_step, columns, high_pass))
            return replace(choose(file, CSV.channels(file)), source="shipped")
    if not Path(reference).suffix and not os.path.exists(reference):
        raise InputError(f"{str(reference)!r} is neither a file nor a shipped record ({', '.join(_SHIPPED)})")
    file = read_file(reference, Stated(component, unit, time_step, columns, high_pass))
    return choose(file, format_of(file).channels(file))


def format_of(file: RecordFile) -> RecordFormat:
    """Return the format of a file.

    Content comes first. The extension only says which format is tried first, and whose reader explains what is wrong
    with a file that no format recognises.

    Parameters
    ----------
    file : RecordFile
        The file.

    Returns
    -------
    RecordFormat
        One of `FORMATS`.

    Raises
    ------
    InputError
        It is in none of them.
    """
    suffix = file.path.suffix.lower()
    named = [known for known in FORMATS if suffix in known.suffixes]
    found = next((known for known in (*named, *FORMATS, ARCHIVE) if known.recognises(file)), None)
    if file.stated.columns != FROM_FILE:
        if found not in (None, CSV, NUMBERS, ARCHIVE):
            problem = f"ground_motion.columns (--columns) is {quoted(file.stated.columns)}, not {FROM_FILE!r}"
            raise InputError(f"{file.path}: a file in format {found.name} says what it holds; {problem}")
        return NUMBERS if found is not ARCHIVE else found
    if found is not None:
        return found
    if named:
        return named[0]
    _check_first_lines(file)
    names = ", ".join(known.name for known in FORMATS)
    raise InputError(f"{file.path}: not a ground motion in a format that is read: {names}")


#: Files inside an archive are in any of the formats.
ARCHIVE = archive_format(format_of)


def _check_first_lines(file: RecordFile) -> None:
    """Refuse a file in none of the formats by what its first lines say of it, where they do."""
    for line_number, line in enumerate(file.lines[:_LINES] if file.is_text else (), 1):
        if re.match(r"\s*(?:[0-9]\s+)?(?:un-?corrected|unprocessed|raw)\b", line, re.IGNORECASE):
            raise file.error(line_number, f"an uncorrected record, by {quoted(line)}; a corrected one is required")
        if (quantity := named_quantity(line)) and line_number <= 4:
            raise file.error(line_number, f"a {quantity}, by {quoted(line)}; an acceleration is required")
