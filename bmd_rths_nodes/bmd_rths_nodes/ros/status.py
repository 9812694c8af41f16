"""Status of a node, as it travels on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.node_status import HARDWARE_ID, STATES, NodeStatus

__all__ = ["ERROR", "HARDWARE_ID", "OK", "WARN", "NodeStatus", "from_message", "to_message"]

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


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
        if entry.hardware_id == HARDWARE_ID and state in STATES:
            found.append(NodeStatus(entry.name, NodeState(state), entry.level, entry.message, values, stamp))
    return found
