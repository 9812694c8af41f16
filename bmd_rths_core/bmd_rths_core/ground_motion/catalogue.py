"""What ground motions a folder holds, and what is wrong with its other files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile, read_file
from bmd_rths_core.ground_motion.formats.record_format import Channel, check_corrected, stated_channel, to_motion
from bmd_rths_core.ground_motion.formats.stated import Stated
from bmd_rths_core.ground_motion.intensity import Intensity, intensity
from bmd_rths_core.ground_motion.library import format_of
from bmd_rths_core.ground_motion.motion import GroundMotion


@dataclass(frozen=True)
class CatalogueEntry:
    """One component of a file.

    Parameters
    ----------
    format : str
        Name of the format.
    component : str
        Name of the component, "" when the file does not name it.
    motion : GroundMotion
        The record.
    intensity : Intensity
        Its measures.
    states_unit : bool
        The file states its unit. Where it does not, accelerations are in that unknown unit instead of m/s², and only
        durations and the frequency mean something.
    note : str
        What a person should know of the file, "" when there is nothing.
    """

    format: str
    component: str
    motion: GroundMotion
    intensity: Intensity
    states_unit: bool
    note: str = ""


def record_files(folder: str | Path) -> list[Path]:
    """Return the files below a folder, or the one file that is named.

    Parameters
    ----------
    folder : str or Path
        Where to look.

    Returns
    -------
    list of Path
        In alphabetical order, without hidden files and folders.

    Raises
    ------
    InputError
        There is no such folder or file.
    """
    if os.path.isfile(folder):
        return [Path(folder)]
    if not os.path.isdir(folder):
        raise InputError(f"{str(folder)!r}: no such folder")
    folder = Path(folder)
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return [path for path in found if not any(part.startswith(".") for part in path.relative_to(folder).parts)]


def catalogue(path: str | Path, stated: Stated = Stated()) -> list[CatalogueEntry]:  # noqa: B008  (it is frozen)
    """Read a file and measure every component in it.

    Parameters
    ----------
    path : str or Path
        The file.
    stated : Stated
        What a person says of files that do not say it themselves.

    Returns
    -------
    list of CatalogueEntry
        One for each component.

    Raises
    ------
    InputError
        The file cannot be read, is no record, or anything is wrong with it.
    """
    file = read_file(path, stated)
    known = format_of(file)
    try:
        channels = known.channels(file)
    except InputError as error:
        if known.recognises(file):
            raise
        raise InputError(f"{path}: not a record: {str(error).removeprefix(f'{path}: ')}") from error
    return [_entry(file, known.name, channel, several=len(channels) > 1) for channel in channels]


def _entry(file: RecordFile, format_name: str, channel: Channel, several: bool) -> CatalogueEntry:
    check_corrected(file, channel)
    channel = stated_channel(file, channel)
    motion = to_motion(file, channel, 1.0 if channel.unit is None else channel.unit, several)
    known = channel.unit is not None
    return CatalogueEntry(format_name, channel.component, motion, intensity(motion), known, channel.note)
