"""The ground motions of a campaign: all that a folder holds, or those of a list."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.catalogue import record_files
from bmd_rths_core.ground_motion.config import GroundMotionConfig
from bmd_rths_core.ground_motion.formats.record_file import RecordFile, read_file
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE, ONLY
from bmd_rths_core.ground_motion.library import FORMATS, read_ground_motion, shipped_records
from bmd_rths_core.ground_motion.motion import GroundMotion


class CampaignMotion(NamedTuple):
    """A record of a campaign, as its file has it.

    Parameters
    ----------
    record : str
        Absolute path, or the name of a shipped record.
    component, unit : str
        As in the section ``ground_motion``.
    motion : GroundMotion
        The record, not yet resampled and scaled.
    """

    record: str
    component: str
    unit: str
    motion: GroundMotion

    def select(self, config: GroundMotionConfig) -> GroundMotionConfig:
        """Return a section of the configuration with this record.

        Parameters
        ----------
        config : GroundMotionConfig
            What is asked for besides: peak, length.
        """
        return replace(config, record=self.record, component=self.component, unit=self.unit)


class MotionSet(NamedTuple):
    """The records of a campaign.

    Parameters
    ----------
    motions : list of CampaignMotion
        What is run.
    left_out : dict of str to str
        Files of a folder that cannot be run as they are, and why.
    """

    motions: list[CampaignMotion]
    left_out: dict[str, str]


def read_motions(path: str | Path) -> MotionSet:
    """Read the ground motions of a campaign.

    Parameters
    ----------
    path : str or Path
        A folder; a record; or a list with ``file[,component[,unit]]`` in every line, whose paths are relative to it. In
        a list empty lines and what follows ``#`` do not count, and a file may also be the name of a shipped record.

    Returns
    -------
    MotionSet
        Of a folder every file that needs neither component nor unit: nothing is guessed. The others are left out.

    Raises
    ------
    InputError
        There is no such file or folder, a record of a list cannot be read or is there twice, or there is nothing to
        run.
    """
    path = Path(path)
    if path.is_dir():
        found = _of_folder(path)
    else:
        file = read_file(path)
        is_record = any(known.recognises(file) for known in FORMATS)
        found = MotionSet([_motion(str(path))] if is_record else _of_list(file), {})
    if not found.motions:
        raise InputError(f"{path}: no ground motion that can be run")
    return found


def _of_folder(folder: Path) -> MotionSet:
    found = MotionSet([], {})
    for path in record_files(folder):
        try:
            found.motions.append(_motion(str(path)))
        except InputError as error:
            found.left_out[path.relative_to(folder).as_posix()] = str(error).removeprefix(f"{path}: ")
    return found


def _of_list(file: RecordFile) -> list[CampaignMotion]:
    motions: list[CampaignMotion] = []
    lines: dict[tuple[str, str, str], int] = {}
    for number, line in enumerate(file.lines, 1):
        cells = [cell.strip() for cell in line.partition("#")[0].split(",")]
        if cells == [""]:
            continue
        if len(cells) > 3 or not cells[0]:
            raise file.error(number, f"{line.strip()!r}; file[,component[,unit]] is required")
        name, component, unit = (*cells, "", "")[:3]
        record = name if name in shipped_records() else str(file.path.parent / name)
        try:
            motions.append(_motion(record, component or ONLY, unit or FROM_FILE))
        except InputError as error:
            raise file.error(number, str(error)) from error
        first = lines.setdefault(motions[-1][:3], number)
        if first != number:
            raise file.error(number, f"{line.strip()!r} stands in line {first} already; each motion is run once")
    return motions


def _motion(record: str, component: str = ONLY, unit: str = FROM_FILE) -> CampaignMotion:
    motion = read_ground_motion(record, component, unit)
    return CampaignMotion(record if record in shipped_records() else os.path.abspath(record), component, unit, motion)
