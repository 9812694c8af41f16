"""What the nodes of a test agree on before step 0: who takes part, which test it is, and with which parameters.

The numerical substructure makes an id for each test and tells it. Every other node takes it over while it waits, and
repeats it in each status. A status of another test, or of a second node of a role, is not believed.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE
from bmd_rths_nodes.ros.status import NodeStatus

#: A node that has told nothing for this long is gone [s]; every node tells its status once a second.
FORGOTTEN_AFTER = 3.0

#: A status that is older, or from further in the future, is one of a recording, or of a computer with another time [s].
LARGEST_AGE = 10.0

#: Keys of a status.
CONFIGURATION = "configuration"
PARAMETERS = "parameters."

#: So many differences are told.
MOST_DIFFERENCES = 3

_TAKING_PART = (NodeState.WAITING, NodeState.READY, NodeState.RUNNING)


class Heard(Enum):
    """What a status is to the node that heard it."""

    IGNORED = "of another test, or of a second node"
    BELIEVED = "of a node of this test"
    ADOPTED = "of the numerical substructure, whose test is now that of this node"
    LATE = "of the numerical substructure, whose test runs without this node"
    RIVAL = "of a second node of the own role"


def new_instance() -> str:
    """Return what tells this process from every other one, and tells a person where it runs."""
    return f"process {os.getpid()} on {socket.gethostname()}, {os.urandom(3).hex()}"


def is_of_process(instance: str, process_id: int) -> bool:
    """Tell whether an instance is that of a process of this computer.

    Parameters
    ----------
    instance : str
        See `new_instance`.
    process_id : int
        Process id.
    """
    return instance.startswith(f"process {process_id} on {socket.gethostname()}, ")


def new_run() -> str:
    """Return the id of a new test."""
    return f"{time.strftime('%Y%m%dT%H%M%S')}-{os.urandom(3).hex()}"


def with_motion(shared: Mapping[str, Mapping[str, Any]], motion: GroundMotion) -> Mapping[str, Mapping[str, Any]]:
    """Return parameters with what the ground motion really is: a file of one name need not be the same everywhere."""
    return {**shared, "ground_motion": {**shared["ground_motion"], "sha256": motion.sha256}}


@dataclass
class _Member:
    """A node that takes part."""

    instance: str
    heard_at: float
    hashes: dict[str, str] = field(default_factory=dict)
    values: dict[str, dict[str, Any]] = field(default_factory=dict)


class Agreement:
    """What one node knows of the others of its test.

    Parameters
    ----------
    role : str
        Role of the node.
    instance : str
        See `new_instance`.

    Attributes
    ----------
    run : str
        Id of the test; empty while there is none.
    """

    def __init__(self, role: str, instance: str) -> None:
        self._role = role
        self._instance = instance
        self._shared: dict[str, dict[str, Any]] = {}
        self._own_hashes: dict[str, str] = {}
        self.run = ""
        self._forget()

    def _forget(self) -> None:
        self._members: dict[str, _Member] = {}
        self._seconds: dict[str, tuple[str, float]] = {}
        self._strange_clock: tuple[float, float] | None = None

    def begin(self, shared: Mapping[str, Mapping[str, Any]]) -> None:
        """Expect a new test; the numerical substructure makes its id.

        Parameters
        ----------
        shared : Mapping of str to Mapping
            Resolved parameters by section, as plain values.
        """
        self._shared = {name: dict(values) for name, values in shared.items()}
        self._own_hashes = {name: _hash(values) for name, values in self._shared.items()}
        self.run = new_run() if self._role == NUMERICAL_SUBSTRUCTURE else ""
        self._forget()

    def identity(self) -> dict[str, str]:
        """Return what stands in every status."""
        return {"run": self.run, "instance": self._instance}

    def values(self) -> dict[str, str]:
        """Return what else to tell: a hash of each section, and the parameters of those that are not the same."""
        if not self._shared:
            return {}
        differing = {
            f"{PARAMETERS}{name}": json.dumps(self._shared[name])
            for name in self._differing_sections()
            if name in self._shared
        }
        return {CONFIGURATION: json.dumps(self._own_hashes), **differing}

    def hear(self, status: NodeStatus, now: float, free: bool) -> Heard:
        """Judge a status.

        Parameters
        ----------
        status : NodeStatus
            The status.
        now : float
            Time of `time.perf_counter` [s].
        free : bool
            The node is in no test, so that it can take part in a new one.

        Returns
        -------
        Heard
        """
        fresh = abs(time.time() - status.stamp) <= LARGEST_AGE
        if status.role == self._role:
            return self._hear_own_role(status, now, fresh)
        adopted = self._adopts(status, now, free, fresh)
        if status.run != self.run:
            late = not self.run and fresh and free and status.state is NodeState.RUNNING
            return Heard.LATE if late and status.role == NUMERICAL_SUBSTRUCTURE else Heard.IGNORED
        member = self._members.get(status.role)
        if member is not None and member.instance != status.instance:
            if now - member.heard_at < FORGOTTEN_AFTER:
                self._seconds[status.role] = (status.instance, now)
                return Heard.IGNORED
            member = None
        if member is None:
            member = self._members[status.role] = _Member(status.instance, now)
        member.heard_at = now
        _take_configuration(member, status)
        return Heard.ADOPTED if adopted else Heard.BELIEVED

    def obstacle(self, now: float) -> str:
        """Return why no test can begin, in one line; empty when nothing is known that is in the way.

        Parameters
        ----------
        now : float
            Time of `time.perf_counter` [s].
        """
        seconds = (
            f"a second {role} is there ({instance})"
            for role, (instance, heard_at) in self._seconds.items()
            if now - heard_at < FORGOTTEN_AFTER
        )
        clock = []
        if self._strange_clock is not None and now - self._strange_clock[1] < FORGOTTEN_AFTER and not self.run:
            clock = [
                f"what {NUMERICAL_SUBSTRUCTURE} tells is {self._strange_clock[0]:.0f} s old by the clock of this "
                "computer: it is a recording, or one of the clocks is wrong"
            ]
        return "; ".join([*seconds, *clock, *self._differences()])

    # ---- details

    def _hear_own_role(self, status: NodeStatus, now: float, fresh: bool) -> Heard:
        if status.instance == self._instance or not fresh:
            return Heard.IGNORED
        if status.state in _TAKING_PART:
            self._seconds[self._role] = (status.instance, now)
            return Heard.RIVAL
        self._seconds.pop(self._role, None)
        return Heard.IGNORED

    def _adopts(self, status: NodeStatus, now: float, free: bool, fresh: bool) -> bool:
        """Take part in the test of the numerical substructure, if it offers one that is new."""
        offered = status.role == NUMERICAL_SUBSTRUCTURE and status.run not in ("", self.run)
        if not (offered and free and status.state in (NodeState.WAITING, NodeState.READY)):
            return False
        if not fresh:
            self._strange_clock = (time.time() - status.stamp, now)
            return False
        leader = self._members.get(NUMERICAL_SUBSTRUCTURE)
        if leader is not None and leader.instance != status.instance and now - leader.heard_at < FORGOTTEN_AFTER:
            self._seconds[NUMERICAL_SUBSTRUCTURE] = (status.instance, now)
            return False
        self._forget()
        self.run = status.run
        return True

    def _hashes(self) -> Iterator[tuple[str, dict[str, str]]]:
        yield self._role, self._own_hashes
        for role, member in self._members.items():
            yield role, member.hashes

    def _differing_sections(self) -> list[str]:
        """Return the sections that are not the same in every node that has them."""
        found: dict[str, set[str]] = {}
        for _, hashes in self._hashes():
            for name, value in hashes.items():
                found.setdefault(name, set()).add(value)
        return sorted(name for name, values in found.items() if len(values) > 1)

    def _differences(self) -> Iterator[str]:
        """Yield which parameter of which node differs, with the values; the first few."""
        told = 0
        for section in self._differing_sections():
            roles = sorted(role for role, hashes in self._hashes() if section in hashes)
            known = self._known_values(section)
            keys = sorted({key for values in known.values() for key in values})
            lines = [line for key in keys if (line := _difference(f"{section}.{key}", key, known))]
            for line in lines or [f"the parameters {section} of {', '.join(roles)} differ"]:
                told += 1
                if told <= MOST_DIFFERENCES:
                    yield line
        if told > MOST_DIFFERENCES:
            yield f"{told - MOST_DIFFERENCES} more parameters differ"

    def _known_values(self, section: str) -> dict[str, dict[str, Any]]:
        """Return the parameters of a section by role; who tells the same hash has the same ones."""
        by_hash = {
            member.hashes[section]: member.values[section]
            for member in self._members.values()
            if section in member.hashes and section in member.values
        }
        if section in self._shared:
            by_hash[self._own_hashes[section]] = self._shared[section]
        return {
            role: by_hash[hashes[section]] for role, hashes in sorted(self._hashes()) if hashes.get(section) in by_hash
        }


def _hash(values: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


def _take_configuration(member: _Member, status: NodeStatus) -> None:
    """Note what a node tells of its parameters; what cannot be understood is left out."""
    if CONFIGURATION not in status.values:
        return
    member.hashes = {name: value for name, value in _object(status.values[CONFIGURATION]).items() if _is_text(value)}
    member.values = {
        key.removeprefix(PARAMETERS): _object(value)
        for key, value in status.values.items()
        if key.startswith(PARAMETERS)
    }


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _object(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _difference(name: str, key: str, known: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the values of a parameter and the nodes that have them; empty when there is one value only."""
    roles: dict[str, list[str]] = {}
    for role, values in known.items():
        roles.setdefault(json.dumps(values[key]) if key in values else "not there", []).append(role)
    if len(roles) < 2:
        return ""
    return f"{name} is " + " and ".join(f"{value} in {', '.join(found)}" for value, found in roles.items())
