"""A format of ground motions, the components a file in it holds, and the choice of one of them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile, read_file
from bmd_rths_core.ground_motion.formats.units import listed, quoted, unit_factor
from bmd_rths_core.ground_motion.motion import GroundMotion

#: The component of a file that has only one.
ONLY = "only"

#: The unit of a file that states it.
FROM_FILE = "from_file"

#: Units a person may give for a file that states none.
UNIT_CHOICES = (FROM_FILE, "g", "m/s2", "cm/s2", "gal")


@dataclass(frozen=True, eq=False)  # arrays have no single truth value, so == compares identity
class Channel:
    """One component of a record, as its file holds it.

    Parameters
    ----------
    component : str
        Its name in the file, "" when the file does not name it.
    time_step : float
        Time between two points [s].
    values : ndarray, shape (N,)
        Ground acceleration in the unit of the file.
    unit : float or None
        That unit in m/s², None when the file does not state it.
    """

    component: str
    time_step: float
    values: NDArray[np.float64]
    unit: float | None


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
        file = read_file(path)
        return choose(file, self.channels(file), component, unit)


def choose(file: RecordFile, channels: list[Channel], component: str, unit: str) -> GroundMotion:
    """Return one component of a file.

    Parameters
    ----------
    file : RecordFile
        The file.
    channels : list of Channel
        The components it holds.
    component, unit : str
        As in `RecordFormat.read`.

    Returns
    -------
    GroundMotion
        The record in m/s², named after the file and, where this has several, after the component.

    Raises
    ------
    InputError
        Component or unit are missing or contradict the file.
    """
    channel = _chosen(file, channels, component)
    if channel.unit is None and unit == FROM_FILE:
        raise InputError(f"{file.path}: the file states no unit; ground_motion.unit must give it: {_units()}")
    if channel.unit is not None and unit != FROM_FILE:
        raise InputError(f"{file.path}: the file states its unit; ground_motion.unit is {unit!r}, not {FROM_FILE!r}")
    factor = channel.unit if channel.unit is not None else unit_factor(unit)
    if factor is None:
        raise InputError(f"ground_motion.unit: {unit!r} is not allowed; {_units()} is required")
    return to_motion(file, channel, factor, several=len(channels) > 1)


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
        Its time step is not a finite number > 0, or it is not two or more finite numbers.
    """
    suffix = "_" + re.sub(r"[^A-Za-z0-9.+-]+", "_", channel.component).strip("_") if several else ""
    with np.errstate(over="ignore"):  # what becomes infinite is refused
        acceleration = channel.values * factor
    return GroundMotion(file.path.stem + suffix, channel.time_step, acceleration, str(file.path), file.sha256)


def _chosen(file: RecordFile, channels: list[Channel], component: str) -> Channel:
    if len(channels) == 1 and component == ONLY:
        return channels[0]
    names = [channel.component for channel in channels]
    if names == [""]:
        problem = f"one component without a name; ground_motion.component is {quoted(component)}, not {ONLY!r}"
        raise InputError(f"{file.path}: {problem}")
    matches = [channel for channel in channels if _same(channel.component, component)]
    if len(matches) != 1:
        found = f"{len(names)} components" if component == ONLY else f"{len(matches)} components {quoted(component)}"
        raise InputError(f"{file.path}: {found}; ground_motion.component (--component) must be one of {listed(names)}")
    return matches[0]


def _same(name: str, other: str) -> bool:
    return name.casefold().split() == other.casefold().split()


def _units() -> str:
    return ", ".join(UNIT_CHOICES[1:-1]) + f" or {UNIT_CHOICES[-1]}"
