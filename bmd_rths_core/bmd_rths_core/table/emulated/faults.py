"""Faults of a virtual table controller and of the network to it, on demand, by seed."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.table.emulated.fault_kinds import KINDS, SENSORS

#: Faults whose value is the name of a sensor.
_OF_A_SENSOR = ("stuck", "nan")

#: Faults that only a table with hydraulics can have.
_OF_THE_HYDRAULICS = ("valve", "pressure")

#: How long a packet is held back by "reordering" [ns]: more than a step at 200 Hz.
REORDERING_DELAY = 6_000_000

_FAULT = re.compile(r"(?P<name>[a-z_]+)(=(?P<value>[^@]*))?(@(?P<step>[0-9]{1,9}))?", re.ASCII)


class Fault(NamedTuple):
    """One fault.

    Parameters
    ----------
    name : str
        One of `KINDS`.
    value : float
        Its size, in the unit of `KINDS`.
    step : int
        Step index of the command it begins with; 0 begins at once.
    """

    name: str
    value: float
    step: int


def parse_fault(text: str, model: str = "servo_hydraulic", floors: int = 999) -> Fault:
    """Return the fault that a person wrote.

    Parameters
    ----------
    text : str
        ``NAME[=VALUE][@STEP]``.
    model : str
        `VirtualControllerConfig.model` of the table that shall have it.
    floors : int
        Number of its floor accelerometers.

    Returns
    -------
    Fault

    Raises
    ------
    InputError
        It is none, or the table cannot have it.
    """
    match = _FAULT.fullmatch(text)
    if match is None or match["name"] not in KINDS:
        raise InputError(f"fault {text!r}: NAME[=VALUE][@STEP] with one of {', '.join(KINDS)} is required")
    name, value = match["name"], match["value"]
    if name in _OF_THE_HYDRAULICS and model != "servo_hydraulic":
        raise InputError(f"fault {text!r}: the {model} model has no hydraulics; model servo_hydraulic is required")
    if value is None:
        size = KINDS[name][3]
    else:
        size = _sensor(text, value, floors) if name in _OF_A_SENSOR else _size(text, name, value)
    return Fault(name, size, int(match["step"] or 0))


def _sensor(text: str, sensor: str, floors: int) -> float:
    if sensor in SENSORS:
        return float(SENSORS.index(sensor))
    floor = re.fullmatch(r"floor_([1-9][0-9]{0,2})", sensor, re.ASCII)
    if floor is None or int(floor[1]) > floors:
        known = f"{', '.join(SENSORS)}, floor_1 to floor_{floors}"
        raise InputError(f"fault {text!r}: {sensor!r} is no sensor; one of {known} is required")
    return float(len(SENSORS) - 1 + int(floor[1]))


def _size(text: str, name: str, value: str) -> float:
    _, unit, highest, _ = KINDS[name]
    try:
        size = float(value)
    except ValueError:
        size = -1.0
    if not unit or not 0.0 <= size <= highest:
        allowed = f"0 to {highest:g} {unit}" if unit else "no value"
        raise InputError(f"fault {text!r}: {value!r} is not allowed; {allowed} is required")
    return size


class Faults:
    """The faults that are active.

    Parameters
    ----------
    faults : iterable of Fault
        Those of the beginning; of one name the last counts.
    """

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._faults = {fault.name: fault for fault in faults}
        self._step = -1

    def set(self, fault: Fault) -> None:
        """Add a fault or change it.

        Parameters
        ----------
        fault : Fault
            The fault.
        """
        self._faults[fault.name] = fault

    def clear(self, name: str) -> None:
        """Take a fault away.

        Parameters
        ----------
        name : str
            Its name; one that is not there does no harm.
        """
        self._faults.pop(name, None)

    def reached(self, step: int) -> None:
        """Begin the faults of a step.

        Parameters
        ----------
        step : int
            Step index of the newest command, −1 before the first one.
        """
        self._step = step

    def active(self, name: str) -> bool:
        """Tell whether a fault is active.

        Parameters
        ----------
        name : str
            Its name.
        """
        fault = self._faults.get(name)
        return fault is not None and (fault.step == 0 or self._step >= fault.step)

    def value(self, name: str, otherwise: float = 0.0) -> float:
        """Return the size of a fault.

        Parameters
        ----------
        name : str
            Its name.
        otherwise : float
            Returned when it is not active.
        """
        return self._faults[name].value if self.active(name) else otherwise


class FaultyNetwork:
    """What a network does to packets in one direction.

    Parameters
    ----------
    faults : Faults
        The faults, which may change at any time.
    seed : int
        Seed of everything random.
    """

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults = faults
        self._random = np.random.default_rng(seed)

    def transmit(self, data: bytes, now: int) -> list[tuple[int, bytes]]:
        """Send a packet through.

        Parameters
        ----------
        data : bytes
            The packet.
        now : int
            Time [ns].

        Returns
        -------
        list of (int, bytes)
            Time of arrival [ns] and bytes of what arrives: nothing, the packet, or more than one.
        """
        copies = 0 if self._happens("loss") else 1
        copies += self._happens("duplicates")
        arrivals = []
        for _ in range(copies):
            due = now + self._milliseconds("delay")
            if self._faults.active("jitter"):
                due += int(self._random.uniform() * self._milliseconds("jitter"))
            if self._happens("reordering"):
                due += REORDERING_DELAY
            arrivals.append((due, self._flipped(data) if self._happens("bit_flips") else data))
        return arrivals

    def _milliseconds(self, name: str) -> int:
        return int(self._faults.value(name) * 1e6)

    def _happens(self, name: str) -> bool:
        return self._faults.active(name) and bool(100.0 * self._random.uniform() < self._faults.value(name))

    def _flipped(self, data: bytes) -> bytes:
        bit = int(self._random.integers(8 * len(data)))
        wrong = bytearray(data)
        wrong[bit // 8] ^= 1 << bit % 8
        return bytes(wrong)
