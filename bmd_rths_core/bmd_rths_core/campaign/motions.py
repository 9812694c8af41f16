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
    time_step : float
        As ``record_time_step`` of that section [s].
    columns : str
        As in that section.
    """

    record: str
    component: str
    unit: str
    motion: GroundMotion
    time_step: float = 0.0
    columns: str = FROM_FILE

    def select(self, config: GroundMotionConfig) -> GroundMotionConfig:
        """Return a section of the configuration with this record.

        Parameters
        ----------
        config : GroundMotionConfig
            What is asked for besides: peak, length.
        """
        return replace(
            config,
            record=self.record,
            component=self.component,
            unit=self.unit,
            record_time_step=self.time_step,
            columns=self.columns,
        )


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


def read_motions(path: str | Path, asked: GroundMotionConfig = GroundMotionConfig()) -> MotionSet:  # noqa: B008
    """Read the ground motions of a campaign.

    Parameters
    ----------
    path : str or Path
        A folder; a record; or a list with ``file[,component[,unit]]`` in every line, whose paths are relative to it. In
        a list empty lines and what follows ``#`` do not count, and a file may also be the name of a shipped record.
    asked : GroundMotionConfig
        Says what files do not: component, unit, time step and columns. A file of a folder or list that can be read
        without is.

    Returns
    -------
    MotionSet
        Of a folder every file that can be read with what is said: nothing is guessed. The others are left out.

    Raises
    ------
    InputError
        There is no such file or folder, a record of a list cannot be read or is there twice, or there is nothing to
        run.
    """
    path = Path(path)
    if path.is_dir():
        found = _of_folder(path, asked)
    else:
        file = read_file(path)
        said = asked.columns != FROM_FILE
        is_record = said or any(known.recognises(file) for known in FORMATS)
        found = MotionSet([_motion(str(path), asked)] if is_record else _of_list(file, asked), {})
    if not found.motions:
        raise InputError(f"{path}: no ground motion that can be run")
    return found


def _of_folder(folder: Path, asked: GroundMotionConfig) -> MotionSet:
    found = MotionSet([], {})
    for path in record_files(folder):
        try:
            found.motions.append(_motion_of_many(str(path), asked))
        except InputError as error:
            found.left_out[path.relative_to(folder).as_posix()] = str(error).removeprefix(f"{path}: ")
    return found


def _of_list(file: RecordFile, asked: GroundMotionConfig) -> list[CampaignMotion]:
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
            own = replace(asked, component=component or asked.component, unit=unit or asked.unit)
            motions.append(_motion(record, own) if component or unit else _motion_of_many(record, own))
        except InputError as error:
            raise file.error(number, str(error)) from error
        first = lines.setdefault(motions[-1][:3], number)
        if first != number:
            raise file.error(number, f"{line.strip()!r} stands in line {first} already; each motion is run once")
    return motions


def _motion_of_many(record: str, asked: GroundMotionConfig) -> CampaignMotion:
    """Read a record among others: by what its file says, or else by what is said of all."""
    says_all = replace(asked, component=ONLY, unit=FROM_FILE, record_time_step=0.0, columns=FROM_FILE)
    if asked == says_all:
        return _motion(record, asked)
    try:
        return _motion(record, says_all)
    except InputError:
        return _motion(record, asked)


def _motion(record: str, asked: GroundMotionConfig) -> CampaignMotion:
    step, columns = asked.record_time_step, asked.columns
    corrected = asked.high_pass_frequency > 0.0
    motion = read_ground_motion(
        record, asked.component, asked.unit, time_step=step, columns=columns, high_pass=corrected
    )
    place = record if record in shipped_records() else os.path.abspath(record)
    return CampaignMotion(place, asked.component, asked.unit, motion, step, columns)
