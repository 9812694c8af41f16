"""Status of a node, as it travels on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bmd_rths_core.loop.states import NodeState

HARDWARE_ID = "bmd_rths"

_STATES = {str(state) for state in NodeState}

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


@dataclass(frozen=True)
class NodeStatus:
    """What a node says of itself.

    Parameters
    ----------
    node : str
        Fully qualified node name.
    state : NodeState
        What it does.
    level : bytes
        `OK`, `WARN` or `ERROR`.
    message : str
        One line for a person.
    values : Mapping of str to str
        Everything else.
    stamp : float
        Wall time at which it was said [s].
    """

    node: str
    state: NodeState
    level: bytes = OK
    message: str = ""
    values: Mapping[str, str] = field(default_factory=dict)
    stamp: float = 0.0

    @property
    def run(self) -> str:
        """Id of the test the node takes part in; empty while there is none."""
        return self.values.get("run", "")

    @property
    def instance(self) -> str:
        """What tells its process from every other one."""
        return self.values.get("instance", "")

    @property
    def role(self) -> str:
        """Role of the node: its name without namespace."""
        return self.node.rpartition("/")[2]


def to_message(status: NodeStatus, seconds: int, nanoseconds: int) -> DiagnosticArray:
    """Return a status as a diagnostics message.

    Parameters
    ----------
    status : NodeStatus
        What to say.
    seconds, nanoseconds : int
        Wall time of ``header.stamp``.

    Returns
    -------
    DiagnosticArray
        With one entry.
    """
    message = DiagnosticArray()
    message.header.stamp.sec = seconds
    message.header.stamp.nanosec = nanoseconds
    values = {"state": str(status.state), **status.values}
    message.status = [
        DiagnosticStatus(
            level=status.level,
            name=status.node,
            message=status.message or str(status.state),
            hardware_id=HARDWARE_ID,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
    ]
    return message


def from_message(message: DiagnosticArray) -> list[NodeStatus]:
    """Return the statuses of this project in a diagnostics message; those of others, and unknown states, are left out.

    Parameters
    ----------
    message : DiagnosticArray
        Any diagnostics message.

    Returns
    -------
    list of NodeStatus
    """
    found = []
    stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
    for entry in message.status:
        values = {pair.key: pair.value for pair in entry.values}
        state = values.pop("state", "")
        if entry.hardware_id == HARDWARE_ID and state in _STATES:
            found.append(NodeStatus(entry.name, NodeState(state), entry.level, entry.message, values, stamp))
    return found
