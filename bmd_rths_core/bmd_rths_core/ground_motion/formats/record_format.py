"""A format of ground motions, the components a file in it holds, and the choice of one of them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile, read_file
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE, ONLY, Stated
from bmd_rths_core.ground_motion.formats.units import listed, quoted, unit_factor
from bmd_rths_core.ground_motion.motion import GroundMotion

#: Units a person may give for a file that states none.
UNIT_CHOICES = (FROM_FILE, "g", "m/s2", "cm/s2", "gal")

#: Largest acceleration that is read as one of the ground [m/s²]. The largest recorded is 43 m/s² (Iwate-Miyagi 2008,
#: IWTH25, all components; Aoi, Kunugi & Fujiwara 2008, Science 322).
LARGEST_ACCELERATION = 100.0

#: Time steps that are read [s]: from 100 kHz, faster than any accelerograph, to 5 Hz, which holds nothing above 2.5 Hz.
#: Beyond lie steps in another unit, and rates in place of steps.
SHORTEST_TIME_STEP, LONGEST_TIME_STEP = 1e-5, 0.2


@dataclass(frozen=True, eq=False)  # arrays have no single truth value, so == compares identity
class Channel:
    """One component of a record, as its file holds it.

    Parameters
    ----------
    component : str
        Its name in the file, "" when the file does not name it.
    time_step : float or None
        Time between two points [s], None when the file does not state it.
    values : ndarray, shape (N,)
        Ground acceleration in the unit of the file.
    unit : float or None
        That unit in m/s², None when the file does not state it.
    uncorrected : str
        Where the file says that its baseline is not corrected, "" when it does not.
    alias : str
        Another name by which the component may be asked for, "" without one.
    note : str
        What a person should know of the file, "" when there is nothing.
    """

    component: str
    time_step: float | None
    values: NDArray[np.float64]
    unit: float | None
    uncorrected: str = ""
    alias: str = ""
    note: str = ""


@dataclass(frozen=True)
class RecordFormat:
    """How one format is recognised and read.

    Parameters
    ----------
    name : str
        What people call it.
    suffixes : tuple of str
        Usual extensions in lower case. They decide between formats only where the content does not.
    recognises : callable
        Whether a file is in this format, from its content.
    parse : callable
        The components a file holds, in their order; raises `InputError`.
    """

    name: str
    suffixes: tuple[str, ...]
    recognises: Callable[[RecordFile], bool]
    parse: Callable[[RecordFile], list[Channel]]

    def channels(self, file: RecordFile) -> list[Channel]:
        """Return the components a file holds; a name that several have is followed by their place: ``"UP (4)"``.

        Parameters
        ----------
        file : RecordFile
            The file.

        Raises
        ------
        InputError
            Anything is wrong with the file.
        """
        channels = self.parse(file)
        known = Counter(channel.component for channel in channels)
        return [
            replace(channel, component=f"{channel.component} ({place})".strip())
            if known[channel.component] > 1
            else channel
            for place, channel in enumerate(channels, 1)
        ]

    def read(self, path: str | Path, component: str = ONLY, unit: str = FROM_FILE) -> GroundMotion:
        """Read one component of a file in this format.

        Parameters
        ----------
        path : str or Path
            The file.
        component : str
            Its name, in either case of letters; `ONLY` where the file has only one.
        unit : str
            One of `UNIT_CHOICES`: the unit of a file that states none.

        Returns
        -------
        GroundMotion
            The record in m/s².

        Raises
        ------
        InputError
            The file cannot be read or understood, or component or unit are missing or contradict it.
        """
        file = read_file(path, Stated(component, unit))
        return choose(file, self.channels(file))


def choose(file: RecordFile, channels: list[Channel]) -> GroundMotion:
    """Return the component of a file that is asked for.

    Parameters
    ----------
    file : RecordFile
        The file, and what is stated of it.
    channels : list of Channel
        The components it holds.

    Returns
    -------
    GroundMotion
        The record in m/s², named after the file and, where this has several, after the component.

    Raises
    ------
    InputError
        Component, unit or time step are missing or contradict the file, or it is not corrected.
    """
    channel = _chosen(file, channels, file.stated.component)
    unit = file.stated.unit
    if channel.unit is None and unit == FROM_FILE:
        also = " and no time step" if channel.time_step is None and not file.stated.time_step else ""
        of_time = "; ground_motion.record_time_step (--dt) must give this in s" if also else ""
        problem = f"ground_motion.unit must give it: {_units()} (--unit){of_time}"
        raise InputError(f"{file.path}: the file states no unit{also}; {problem}")
    if channel.unit is not None and unit != FROM_FILE:
        raise InputError(f"{file.path}: the file states its unit; ground_motion.unit is {unit!r}, not {FROM_FILE!r}")
    if channel.time_step is not None and file.stated.time_step > 0.0:
        problem = f"ground_motion.record_time_step (--dt) is {file.stated.time_step:g} s, not 0"
        raise InputError(f"{file.path}: the file states its time step, {channel.time_step:g} s; {problem}")
    check_corrected(file, channel)
    channel = stated_channel(file, channel)
    if channel.unit is None:
        raise InputError(f"ground_motion.unit: {unit!r} is not allowed; {_units()} is required")
    return to_motion(file, channel, channel.unit, several=len(channels) > 1)


def stated_channel(file: RecordFile, channel: Channel) -> Channel:
    """Return a component with the time step and the unit a person states, where the file states none.

    Parameters
    ----------
    file : RecordFile
        The file, and what is stated of it.
    channel : Channel
        A component of it.

    Raises
    ------
    InputError
        Neither states a time step.
    """
    stated = file.stated
    time_step = channel.time_step if channel.time_step is not None else stated.time_step
    if time_step == 0.0 and channel.time_step is None:
        raise InputError(
            f"{file.path}: the file states no time step; ground_motion.record_time_step (--dt) must give it"
        )
    unit = channel.unit if channel.unit is not None or stated.unit == FROM_FILE else unit_factor(stated.unit)
    return replace(channel, time_step=time_step, unit=unit)


def check_corrected(file: RecordFile, channel: Channel) -> None:
    """Check that the baseline of a component is corrected, or will be.

    Parameters
    ----------
    file : RecordFile
        The file, and what is stated of it.
    channel : Channel
        A component of it.

    Raises
    ------
    InputError
        It is neither.
    """
    if channel.uncorrected and not file.stated.high_pass:
        problem = f"{channel.uncorrected}: an uncorrected record; ground_motion.high_pass_frequency > 0 is required"
        raise InputError(f"{file.path}: {problem}")


def to_motion(file: RecordFile, channel: Channel, factor: float, several: bool) -> GroundMotion:
    """Return a component as a ground motion.

    Parameters
    ----------
    file : RecordFile
        The file.
    channel : Channel
        A component of it.
    factor : float
        Its unit in m/s².
    several : bool
        The file has others: the name of the record has to tell which this is.

    Raises
    ------
    InputError
        Its time step or its peak is that of no ground motion, or it is not two or more finite numbers.
    """
    if channel.time_step is None:
        raise InputError(
            f"{file.path}: the file states no time step; ground_motion.record_time_step (--dt) must give it"
        )
    if not SHORTEST_TIME_STEP <= channel.time_step <= LONGEST_TIME_STEP:
        allowed = f"{SHORTEST_TIME_STEP:g} to {LONGEST_TIME_STEP:g} s"
        raise InputError(f"{file.path}: time step {channel.time_step:g} s; {allowed} is read. Is its unit right?")
    suffix = "_" + re.sub(r"[^A-Za-z0-9.+-]+", "_", channel.component).strip("_") if several else ""
    with np.errstate(over="ignore"):  # what becomes infinite is refused
        acceleration = channel.values * factor
    peak = float(np.max(np.abs(acceleration), initial=0.0))
    if channel.unit is not None and LARGEST_ACCELERATION < peak < math.inf:
        point = int(np.argmax(np.abs(acceleration))) + 1
        problem = (
            f"{peak:.4g} m/s² at point {point} is no ground acceleration; at most {LARGEST_ACCELERATION:g} m/s² is read"
        )
        raise InputError(f"{file.path}: {problem}. Is the unit right?")
    return GroundMotion(file.path.stem + suffix, channel.time_step, acceleration, str(file.path), file.sha256)


def _chosen(file: RecordFile, channels: list[Channel], component: str) -> Channel:
    if len(channels) == 1 and component == ONLY:
        return channels[0]
    names = [channel.component for channel in channels]
    if names == [""]:
        problem = f"one component without a name; ground_motion.component is {quoted(component)}, not {ONLY!r}"
        raise InputError(f"{file.path}: {problem}")
    matches = [channel for channel in channels if _same(channel.component, component)]
    matches = matches or [channel for channel in channels if channel.alias and _same(channel.alias, component)]
    if len(matches) != 1:
        found = f"{len(names)} components" if component == ONLY else f"{len(matches)} components {quoted(component)}"
        raise InputError(f"{file.path}: {found}; ground_motion.component (--component) must be one of {listed(names)}")
    return matches[0]


def _same(name: str, other: str) -> bool:
    return name.casefold().split() == other.casefold().split()


def _units() -> str:
    return ", ".join(UNIT_CHOICES[1:-1]) + f" or {UNIT_CHOICES[-1]}"
