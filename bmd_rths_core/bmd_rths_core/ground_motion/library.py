"""Find a ground motion by name or by path."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path

from bmd_rths_core.errors import InputError
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
from bmd_rths_core.ground_motion.formats.record_file import RecordFile, read_file
from bmd_rths_core.ground_motion.formats.record_format import FROM_FILE, ONLY, RecordFormat, choose
from bmd_rths_core.ground_motion.formats.simcenter import SIMCENTER
from bmd_rths_core.ground_motion.motion import GroundMotion

#: The formats that are read. A new one is a new module, and one entry here.
FORMATS: tuple[RecordFormat, ...] = (AT2, CSV, KNET, COSMOS, CSMIP, GEONET, ESM, CWA, JMA, SIMCENTER, MAT)

# Records in the public domain; each is data/<name>.csv in this package.
_SHIPPED = ("el_centro_1940_ns",)

_NUMBERS_ONLY = re.compile(rb"[\s0-9.,EeDd+-]+")


def shipped_records() -> tuple[str, ...]:
    """Return the names of the records that come with this package."""
    return _SHIPPED


def read_ground_motion(reference: str | Path, component: str = ONLY, unit: str = FROM_FILE) -> GroundMotion:
    """Read a shipped record by its name, or a file by its path; the content of the file tells its format.

    Parameters
    ----------
    reference : str or Path
        One of `shipped_records`, or the path of a file in one of `FORMATS`.
    component : str
        Which component of a file with several, in either case of letters; ``"only"`` for a file with one.
    unit : str
        Unit of a file that states none: ``"g"``, ``"m/s2"``, ``"cm/s2"`` or ``"gal"``; ``"from_file"`` for all others.

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
            return replace(CSV.read(path, component, unit), source="shipped")
    if not Path(reference).suffix and not os.path.exists(reference):
        raise InputError(f"{str(reference)!r} is neither a file nor a shipped record ({', '.join(_SHIPPED)})")
    file = read_file(reference)
    return choose(file, format_of(file).channels(file), component, unit)


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
    found = next((known for known in (*named, *FORMATS) if known.recognises(file)), None)
    if found is not None:
        return found
    if named:
        return named[0]
    if _NUMBERS_ONLY.fullmatch(file.content):
        raise InputError(
            f"{file.path}: numbers only; a header with time step and unit is required, as AT2 and CSV have"
        )
    names = ", ".join(known.name for known in FORMATS)
    raise InputError(f"{file.path}: not a ground motion in a format that is read: {names}")
