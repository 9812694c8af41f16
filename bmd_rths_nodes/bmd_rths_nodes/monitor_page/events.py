"""What has happened in a run, told from one status to the next."""

from __future__ import annotations

from typing import Any, NamedTuple

from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.growing_run import Told
from bmd_rths_msgs_py.node_status import NodeStatus
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE

INFO, WARNING, ERROR = "info", "warning", "error"

_LEVEL = {0: INFO, 1: WARNING, 2: ERROR}


class Event(NamedTuple):
    """Something that has happened.

    Parameters
    ----------
    step : int
        Steps that were complete then.
    level : str
        `INFO`, `WARNING` or `ERROR`.
    text : str
        What.
    """

    step: int
    level: str
    text: str

    def as_mapping(self) -> dict[str, Any]:
        """Return it as plain values."""
        return self._asdict()


class EventLog:
    """Find what is new in the statuses of the nodes."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self._before: dict[str, NodeStatus] = {}
        self._taken = self._missed = 0
        self._missed_at = -1

    def update(self, told: list[Told]) -> None:
        """Look at the statuses that were told since the last time."""
        for entry in told[self._taken :]:
            self._look_at(entry)
        self._taken = len(told)

    def _look_at(self, entry: Told) -> None:
        status = entry.status
        before = self._before.get(status.role)
        self._before[status.role] = status
        if before is None or status.state != before.state:
            words = "" if status.message == status.state else f": {status.message}"
            level = ERROR if status.state is NodeState.TRIPPED and status.level > b"\x01" else _level(status)
            self._add(entry, level, f"{_words(status.role)} {status.state}{words}")
        if status.role == NUMERICAL_SUBSTRUCTURE:
            missed = _count(status) - (_count(before) if before is not None else 0)
            if missed > 0:
                self._add_missed(entry, missed)
        trips = _trips(status)
        for trip in trips[len(_trips(before)) if before is not None else 0 :]:
            self._add(entry, ERROR, f"supervisor: {trip}")

    def _add_missed(self, entry: Told, missed: int) -> None:
        """Add missed deadlines to those of the last line, so that what else has happened stays in sight."""
        if self.events and self.events[-1].step == self._missed_at:
            self.events.pop()
            missed += self._missed
        self._missed, self._missed_at = missed, entry.step
        self._add(entry, WARNING, f"{missed} deadline{'s' * (missed > 1)} missed")

    def _add(self, entry: Told, level: str, text: str) -> None:
        self.events.append(Event(entry.step, level, text))


def _level(status: NodeStatus) -> str:
    return _LEVEL.get(status.level[0] if status.level else 0, INFO)


def _words(role: str) -> str:
    return role.replace("_", " ")


def _count(status: NodeStatus) -> int:
    text = status.values.get("missed_deadlines", "")
    return int(text) if text.isdecimal() else 0


def _trips(status: NodeStatus) -> list[str]:
    return [trip for trip in status.values.get("trips", "").split(" | ") if trip]
