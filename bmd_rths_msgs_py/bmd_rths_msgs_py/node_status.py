"""Status of a node, and how it is read from the bytes of a DiagnosticArray, without ROS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.cdr import NANOSECONDS, MalformedMessage, read_stamp

HARDWARE_ID = "bmd_rths"

STATES = {str(state) for state in NodeState}

_ENCAPSULATION_SIZE = 4
_STAMP_SIZE = 8


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
        One byte, the level of a DiagnosticStatus: 0 OK, 1 WARN, 2 ERROR.
    message : str
        One line for a person.
    values : Mapping of str to str
        Everything else.
    stamp : float
        Wall time at which it was said [s].
    """

    node: str
    state: NodeState
    level: bytes = b"\x00"
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

    @property
    def namespace(self) -> str:
        """Namespace of the node, for example ``"/rths"``; empty where it told only its role."""
        return self.node.rpartition("/")[0]


def read_statuses(data: bytes) -> list[NodeStatus]:
    """Return the statuses of this project in a message of /diagnostics; those of others are left out.

    Parameters
    ----------
    data : bytes
        A DiagnosticArray as CDR with encapsulation, of either byte order.

    Returns
    -------
    list of NodeStatus

    Raises
    ------
    MalformedMessage
        The bytes are not such a message.
    """
    stamp = read_stamp(data) / NANOSECONDS
    fields = _Fields(data)
    fields.text()  # frame_id
    found = []
    for _ in range(fields.number()):
        level, name, message, hardware = fields.byte(), fields.text(), fields.text(), fields.text()
        values = {fields.text(): fields.text() for _ in range(fields.number())}
        state = values.pop("state", "")
        if hardware == HARDWARE_ID and state in STATES:
            found.append(NodeStatus(name, NodeState(state), level, message, values, stamp))
    return found


def is_of_others(data: bytes, namespace: str) -> bool:
    """Tell whether a message of /diagnostics is from nodes of this project in another namespace: of another rig.

    Parameters
    ----------
    data : bytes
        A DiagnosticArray as CDR with encapsulation.
    namespace : str
        The own namespace.
    """
    try:
        told = read_statuses(data)
    except MalformedMessage:
        return False
    return bool(told) and all(status.namespace != namespace for status in told)


class _Fields:
    """The fields of a message behind its stamp, in their order."""

    def __init__(self, data: bytes) -> None:
        self._body = data[_ENCAPSULATION_SIZE:]
        self._little = bool(data[1])
        self._at = _STAMP_SIZE

    def byte(self) -> bytes:
        return self._take(1)

    def number(self) -> int:
        self._at = -(-self._at // 4) * 4
        return int.from_bytes(self._take(4), "little" if self._little else "big")

    def text(self) -> str:
        return self._take(self.number())[:-1].decode("utf-8", "replace")

    def _take(self, size: int) -> bytes:
        taken = self._body[self._at : self._at + size]
        if len(taken) < size:
            raise MalformedMessage(f"{len(self._body) + _ENCAPSULATION_SIZE} bytes are too few for a DiagnosticArray")
        self._at += size
        return taken
