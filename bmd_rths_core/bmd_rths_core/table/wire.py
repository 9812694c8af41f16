"""UDP wire format, version 1, between the table driver (host) and a table controller: packets to bytes and back.

Fixed offsets, little-endian, IEEE-754 doubles, SI units, one datagram a packet, as byte-pack blocks of real-time
targets make them; docs/reference/udp_wire_format.md has the layout. A datagram is decoded as a whole, or rejected with
one reason; no bytes whatever raise an exception.
"""

from __future__ import annotations

import math
from enum import Enum, IntEnum, IntFlag
from struct import Struct
from typing import NamedTuple
from zlib import crc32

import numpy as np

from bmd_rths_core.table.controller import TableMeasurement

VERSION = 1

#: Sequence numbers and session ids are counted modulo this.
MODULUS = 2**32

#: Bytes to read of a datagram: more than any packet has, so that one that is too long is seen as such.
LONGEST_DATAGRAM = 4096

_HOST_MAGIC, _CONTROLLER_MAGIC = b"RTHC", b"RTHM"
_HOST = Struct("<4sHHIIqdddI")
_CONTROLLER = Struct("<4sHHIIIHHqdddd")
_CRC = Struct("<I")

HOST_LENGTH = _HOST.size + _CRC.size
#: Length of a controller packet without floors; each floor adds 8 bytes.
CONTROLLER_LENGTH = _CONTROLLER.size + 2 * _CRC.size


class Kind(IntEnum):
    """What a host packet asks for."""

    STATUS = 0
    ARM = 1
    COMMAND = 2
    STOP = 3
    EMERGENCY_STOP = 4
    RESET = 5


class ArmMode(IntEnum):
    """How a controller is armed; it stands in the place of the step index."""

    REAL_TIME = 0
    LOCKSTEP = 1


class ControllerState(IntEnum):
    """What a table controller is doing."""

    IDLE = 0
    ARMED = 1
    RUNNING = 2
    STOPPING = 3
    INTERLOCK = 4


class Interlock(IntFlag):
    """Why a table controller brought its table to rest by itself."""

    DISPLACEMENT = 1
    VELOCITY = 2
    ACCELERATION = 4
    FORCE = 8
    WATCHDOG = 16
    EMERGENCY_STOP = 32
    BAD_PACKET = 64
    TRACKING = 128


def interlock_names(interlock: Interlock) -> str:
    """Return a text that names the reasons of an interlock.

    Parameters
    ----------
    interlock : Interlock
        The bits.
    """
    names = [bit.name.lower().replace("_", " ") for bit in Interlock if bit.name is not None and bit & interlock]
    return ", ".join(names) or "no reason given"


class Rejection(Enum):
    """Why a datagram was not used."""

    LENGTH = "wrong length"
    MAGIC = "wrong magic"
    VERSION = "wrong version"
    CRC = "bad crc"
    CONTENT = "impossible content"


class HostPacket(NamedTuple):
    """A packet from the host to the controller.

    Parameters
    ----------
    kind : Kind
        What is asked for.
    sequence : int
        Number of the packet in its session, modulo 2³².
    step : int
        Step index k of a command, `ArmMode` of an arm packet, else 0.
    time : int
        Test time of the step [ns].
    acceleration, velocity, displacement : float
        Command [m/s², m/s, m]; velocity and displacement are NaN when they are not used.
    session : int
        Session id, chosen by the host.
    """

    kind: Kind
    sequence: int
    step: int
    time: int
    acceleration: float
    velocity: float
    displacement: float
    session: int


class ControllerPacket(NamedTuple):
    """A packet from the controller to the host.

    Parameters
    ----------
    state : ControllerState
        State after the packet it answers.
    sequence : int
        Sequence of the host packet it answers.
    step : int
        Step index of the last command that was applied.
    interlock : Interlock
        Why the controller is in the interlock; no bit when it is not.
    clock : int
        Clock of the controller [ns].
    displacement : float
        Displacement of the table [m].
    acceleration : float
        Absolute acceleration of the table [m/s²].
    actuator_force : float
        Force of the actuator on the table [N].
    base_shear : float
        Interface shear from load cells [N], NaN when there are none.
    floor_accelerations : tuple of float
        Absolute accelerations of the floors from the bottom up [m/s²].
    session : int
        Session id of the packet it answers.
    """

    state: ControllerState
    sequence: int
    step: int
    interlock: Interlock
    clock: int
    displacement: float
    acceleration: float
    actuator_force: float
    base_shear: float
    floor_accelerations: tuple[float, ...]
    session: int

    def measurement(self, applied_command: float) -> TableMeasurement:
        """Return the sensors as the rest of the project knows them.

        Parameters
        ----------
        applied_command : float
            The acceleration command of `step`, which the format does not carry back [m/s²].
        """
        return TableMeasurement(
            step=self.step,
            applied_command=applied_command,
            table_displacement=self.displacement,
            table_acceleration=self.acceleration,
            actuator_force=self.actuator_force,
            base_shear=self.base_shear,
            floor_accelerations=np.array(self.floor_accelerations),
        )


def encode_host_packet(packet: HostPacket) -> bytes:
    """Return the 56 bytes of a host packet.

    Parameters
    ----------
    packet : HostPacket
        The packet.
    """
    body = _HOST.pack(_HOST_MAGIC, VERSION, *packet)
    return body + _CRC.pack(crc32(body))


def decode_host_packet(data: bytes) -> HostPacket | Rejection:
    """Return the host packet in a datagram.

    Parameters
    ----------
    data : bytes
        The datagram.

    Returns
    -------
    HostPacket or Rejection
        The first reason that holds, when it is no packet: length, magic, version, CRC, content. A command must be
        finite and arming must name a mode.
    """
    if len(data) != HOST_LENGTH:
        return Rejection.LENGTH
    magic, version, kind, sequence, step, time, acceleration, velocity, displacement, session = _HOST.unpack_from(data)
    reason = _frame_problem(data, magic == _HOST_MAGIC, version)
    if reason is not None:
        return reason
    if kind not in _KINDS:
        return Rejection.CONTENT
    if (kind == Kind.COMMAND and not math.isfinite(acceleration)) or (kind == Kind.ARM and step not in _ARM_MODES):
        return Rejection.CONTENT
    return HostPacket(_KINDS[kind], sequence, step, time, acceleration, velocity, displacement, session)


def encode_controller_packet(packet: ControllerPacket) -> bytes:
    """Return the 72 + 8 n bytes of a controller packet with n floors.

    Parameters
    ----------
    packet : ControllerPacket
        The packet.
    """
    floors = packet.floor_accelerations
    body = _CONTROLLER.pack(
        _CONTROLLER_MAGIC,
        VERSION,
        packet.state,
        packet.sequence,
        packet.step,
        packet.interlock,
        len(floors),
        0,
        packet.clock,
        packet.displacement,
        packet.acceleration,
        packet.actuator_force,
        packet.base_shear,
    )
    body += _tail(len(floors)).pack(*floors, packet.session)
    return body + _CRC.pack(crc32(body))


def decode_controller_packet(data: bytes, floors: int) -> ControllerPacket | Rejection:
    """Return the controller packet in a datagram.

    Parameters
    ----------
    data : bytes
        The datagram.
    floors : int
        Number n of floors it must have.

    Returns
    -------
    ControllerPacket or Rejection
        The first reason that holds, when it is no packet: length, magic, version, CRC, content. The reserved field must
        be 0, and interlock bits must be known.
    """
    if len(data) != CONTROLLER_LENGTH + 8 * floors:
        return Rejection.LENGTH
    magic, version, state, sequence, step, bits, n, reserved, *sensors = _CONTROLLER.unpack_from(data)
    reason = _frame_problem(data, magic == _CONTROLLER_MAGIC, version)
    if reason is not None:
        return reason
    if state not in _STATES or n != floors or reserved != 0 or bits > _ALL_INTERLOCKS:
        return Rejection.CONTENT
    clock, displacement, acceleration, actuator_force, base_shear = sensors
    *accelerations, session = _tail(floors).unpack_from(data, _CONTROLLER.size)
    return ControllerPacket(
        _STATES[state],
        sequence,
        step,
        Interlock(bits),
        clock,
        displacement,
        acceleration,
        actuator_force,
        base_shear,
        tuple(accelerations),
        session,
    )


def _frame_problem(data: bytes, magic_is_right: bool, version: int) -> Rejection | None:
    if not magic_is_right:
        return Rejection.MAGIC
    if version != VERSION:
        return Rejection.VERSION
    if _CRC.unpack_from(data, len(data) - _CRC.size)[0] != crc32(data[: -_CRC.size]):
        return Rejection.CRC
    return None


def _tail(floors: int) -> Struct:
    """Return the layout of floors and session id."""
    tail = _TAILS.get(floors)
    if tail is None:
        tail = _TAILS[floors] = Struct(f"<{floors}dI")
    return tail


# Look-ups by number; calling an enumeration takes ten times as long.
_KINDS = {int(kind): kind for kind in Kind}
_STATES = {int(state): state for state in ControllerState}
_ARM_MODES = frozenset(int(mode) for mode in ArmMode)
_ALL_INTERLOCKS = sum(Interlock)
_TAILS: dict[int, Struct] = {}
