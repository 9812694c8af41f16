"""Messages of the 200 Hz loop as bytes: CDR packed and read with precompiled structs.

Layout (XCDR1, as every ROS 2 middleware writes these types): four bytes of encapsulation, then the fields, each
aligned to its own size counted from behind the encapsulation. The content of padding bytes is undefined, and a
message may be followed by more bytes than it needs (rclpy does both), so neither is looked at.
"""

from __future__ import annotations

import math
from struct import Struct

import numpy as np

from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import StepStamps

NANOSECONDS = 1_000_000_000

_ENCAPSULATION = {"<": b"\x00\x01\x00\x00", ">": b"\x00\x00\x00\x00"}
_ENCAPSULATION_SIZE = 4
_MAX_STAMP_NS = 2**31 * NANOSECONDS  # header.stamp.sec is an int32

# The header up to and without the text of frame_id: sec, nanosec, length of frame_id with its terminating zero.
_HEAD = {order: Struct(f"{order}iII") for order in "<>"}
_HEAD_SIZE = 12
_BYTES_PER_JOINT = 36  # at least: length and text of the name, three numbers
_VECTORS_SIZE = 48  # the two Vector3 of an Accel or a Wrench
_FIRST_OF_VECTORS = {order: Struct(f"{order}d40x") for order in "<>"}
_FIRST_TWO_OF_VECTORS = {order: Struct(f"{order}2d32x") for order in "<>"}


class MalformedMessage(ValueError):
    """A message that is not what its topic promises. The text says what is wrong with it."""


class ScalarCodec:
    """One number in an AccelStamped (``accel.linear.x``) or a WrenchStamped (``wrench.force.x``).

    Both types have the same bytes: a header and six numbers, of which all but the first are zero.

    Parameters
    ----------
    frame_id : str
        ``header.frame_id`` of the messages that are packed.
    """

    def __init__(self, frame_id: str = "") -> None:
        text = frame_id.encode() + b"\x00"
        self._head = _head_constants(text)
        self._pack = Struct(f"<4siI{_aligned(_HEAD_SIZE + len(text)) - 8}sd40x").pack

    def pack(self, stamp_ns: int, value: float) -> bytes:
        """Return the message as bytes.

        Parameters
        ----------
        stamp_ns : int
            ``header.stamp`` [ns].
        value : float
            The number.

        Returns
        -------
        bytes
            Little-endian CDR with encapsulation.

        Raises
        ------
        ValueError
            The stamp does not fit in a ROS time.
        """
        if not 0 <= stamp_ns < _MAX_STAMP_NS:
            raise ValueError(_stamp_problem(stamp_ns))
        sec, nanosec = divmod(stamp_ns, NANOSECONDS)
        return self._pack(b"\x00\x01\x00\x00", sec, nanosec, self._head, value)

    def unpack(self, data: bytes) -> tuple[int, float]:
        """Return stamp and number of a message from any conforming node.

        Parameters
        ----------
        data : bytes
            The message: CDR of either byte order, with any frame_id.

        Returns
        -------
        stamp_ns : int
            ``header.stamp`` [ns].
        value : float
            The number.

        Raises
        ------
        MalformedMessage
            The bytes are not such a message.
        """
        order, stamp_ns, body = _unpack_vectors(data)
        return stamp_ns, _FIRST_OF_VECTORS[order].unpack_from(data, body)[0]


class PairCodec:
    """Two numbers in an AccelStamped, ``accel.linear.x`` and ``accel.linear.y``.

    A `ScalarCodec` reads the first of them.

    Parameters
    ----------
    frame_id : str
        ``header.frame_id`` of the messages that are packed.
    """

    def __init__(self, frame_id: str = "") -> None:
        self._scalar = ScalarCodec(frame_id)
        self._second = Struct("<d").pack

    def pack(self, stamp_ns: int, values: tuple[float, float]) -> bytes:
        """Return the message as bytes.

        Parameters
        ----------
        stamp_ns : int
            ``header.stamp`` [ns].
        values : (float, float)
            The numbers.

        Returns
        -------
        bytes
            Little-endian CDR with encapsulation.

        Raises
        ------
        ValueError
            The stamp does not fit in a ROS time.
        """
        data = self._scalar.pack(stamp_ns, values[0])
        return data[: 8 - _VECTORS_SIZE] + self._second(values[1]) + data[16 - _VECTORS_SIZE :]

    def unpack(self, data: bytes) -> tuple[int, tuple[float, float]]:
        """Return stamp and numbers of a message from any conforming node.

        Parameters
        ----------
        data : bytes
            The message: CDR of either byte order, with any frame_id.

        Returns
        -------
        stamp_ns : int
            ``header.stamp`` [ns].
        values : (float, float)
            The numbers.

        Raises
        ------
        MalformedMessage
            The bytes are not such a message.
        """
        order, stamp_ns, body = _unpack_vectors(data)
        return stamp_ns, _FIRST_TWO_OF_VECTORS[order].unpack_from(data, body)


class MeasurementCodec:
    """A `TableMeasurement` in a JointTrajectory with one point.

    The joints are ``table, floor_1, ..., floor_n, applied_command``. The point has ``positions`` (of the table),
    ``accelerations`` (of all) and ``effort`` (actuator force at the table, base shear at the first floor), NaN where
    there is nothing to tell, and no ``velocities``.

    Parameters
    ----------
    floors : int
        Number n of floors of the experimental substructure.
    stamps : StepStamps
        Of the steps; that of a measurement tells its step index.
    frame_id : str
        ``header.frame_id`` of the messages that are packed.

    Raises
    ------
    ValueError
        There is no floor.
    """

    def __init__(self, floors: int, stamps: StepStamps, frame_id: str = "") -> None:
        if floors < 1:
            raise ValueError(f"{floors} floors; at least one is required")
        self._floors = floors
        self._step_of = stamps.step
        joints = ["table", *(f"floor_{i}" for i in range(1, floors + 1)), "applied_command"]
        self._names = [name.encode() + b"\x00" for name in joints]
        m = len(joints)
        names = [entry for name in self._names for entry in (len(name), name)]
        self._before_positions = (m, *names, 1, m)
        self._layouts = {(order, base): self._layout(order, base) for order in "<>" for base in (0, 4)}
        text = frame_id.encode() + b"\x00"
        end = _aligned(_HEAD_SIZE + len(text), 4)
        self._head = _head_constants(text)
        self._pack_head = Struct(f"<4siI{end - 8}s").pack
        self._pack_body = self._layouts["<", end % 8].pack
        self._no_positions = (math.nan,) * (m - 1)
        self._no_effort = (math.nan,) * floors

    def _layout(self, order: str, base: int) -> Struct:
        """Return the struct of everything behind frame_id, which begins at `base` (0 or 4) modulo 8."""
        m = len(self._names)
        text = "I"
        at = base + 4
        for name in self._names:
            padding = -len(name) % 4
            text += f"I{len(name)}s{padding}x"
            at += 4 + len(name) + padding
        text += "II"  # number of points, length of positions
        at += 8
        text += f"{-at % 8}x{m}dII{m}dI4x{m}dII"  # velocities are empty: their length touches that of accelerations
        return Struct(order + text)

    def pack(self, stamp_ns: int, measurement: TableMeasurement) -> bytes:
        """Return the message as bytes.

        Parameters
        ----------
        stamp_ns : int
            ``header.stamp`` [ns].
        measurement : TableMeasurement
            The sensors; its step index is not packed, since the stamp says the same.

        Returns
        -------
        bytes
            Little-endian CDR with encapsulation.

        Raises
        ------
        ValueError
            The stamp does not fit in a ROS time, or the number of floors is another one.
        """
        if not 0 <= stamp_ns < _MAX_STAMP_NS:
            raise ValueError(_stamp_problem(stamp_ns))
        sec, nanosec = divmod(stamp_ns, NANOSECONDS)
        _, applied, displacement, acceleration, force, shear, floors = measurement
        m = self._floors + 2
        if len(floors) != self._floors:
            raise ValueError(f"accelerations of {len(floors)} floors; {self._floors} are required")
        return self._pack_head(b"\x00\x01\x00\x00", sec, nanosec, self._head) + self._pack_body(
            *self._before_positions,
            displacement,
            *self._no_positions,
            0,
            m,
            acceleration,
            *floors.tolist(),
            applied,
            m,
            force,
            shear,
            *self._no_effort,
            0,
            0,
        )

    def unpack(self, data: bytes) -> tuple[int, TableMeasurement]:
        """Return stamp and measurement of a message from any conforming node.

        Parameters
        ----------
        data : bytes
            The message: CDR of either byte order, with any frame_id.

        Returns
        -------
        stamp_ns : int
            ``header.stamp`` [ns].
        measurement : TableMeasurement
            The sensors.

        Raises
        ------
        MalformedMessage
            The bytes are not such a message, or the stamp is that of no step.
        """
        order, stamp_ns, end = _unpack_head(data)
        step = self._step_of(stamp_ns)
        if step is None:
            raise MalformedMessage(f"stamp {stamp_ns} ns is not that of a step")
        base = (end + 3) & ~3
        layout = self._layouts[order, base & 7]
        if len(data) < _ENCAPSULATION_SIZE + base + layout.size:
            required = _ENCAPSULATION_SIZE + base + layout.size
            raise MalformedMessage(f"{len(data)} bytes; at least {required} are required for {self._floors} floors")
        values = layout.unpack_from(data, _ENCAPSULATION_SIZE + base)
        m = self._floors + 2
        positions = len(self._before_positions)
        accelerations = positions + m + 2
        effort = accelerations + m + 1
        if (
            values[:positions] != self._before_positions
            or values[positions + m : accelerations] != (0, m)
            or values[effort - 1] != m
        ):
            raise MalformedMessage(f"joint names or array lengths do not fit one point with {self._floors} floors")
        return stamp_ns, TableMeasurement(
            step,
            values[effort - 2],
            values[positions],
            values[accelerations],
            values[effort],
            values[effort + 1],
            np.array(values[accelerations + 1 : effort - 2]),
        )


def read_stamp(data: bytes) -> int:
    """Return the stamp of any message that begins with a header.

    Parameters
    ----------
    data : bytes
        The message as bytes.

    Returns
    -------
    int
        ``header.stamp`` [ns].

    Raises
    ------
    MalformedMessage
        The bytes do not begin with a header.
    """
    return _unpack_head(data)[1]


def count_floors(data: bytes) -> int:
    """Return the number of floors a measurement claims to have, without looking at the rest of it.

    Parameters
    ----------
    data : bytes
        A JointTrajectory as bytes.

    Returns
    -------
    int
        Number of joints less two; at least 1.

    Raises
    ------
    MalformedMessage
        The message is cut, or cannot hold so many joints.
    """
    order, _, end = _unpack_head(data)
    at = _ENCAPSULATION_SIZE + ((end + 3) & ~3)
    floors = int.from_bytes(data[at : at + 4], "little" if order == "<" else "big") - 2
    if not 1 <= floors <= len(data) // _BYTES_PER_JOINT:
        raise MalformedMessage(f"{len(data)} bytes with {floors + 2} joints")
    return floors


def _unpack_head(data: bytes) -> tuple[str, int, int]:
    """Return byte order, stamp [ns] and the end of frame_id counted from behind the encapsulation."""
    if len(data) < _ENCAPSULATION_SIZE + _HEAD_SIZE:
        raise MalformedMessage(f"{len(data)} bytes are too few for a header")
    if data[0] != 0 or data[1] > 1:
        raise MalformedMessage(f"encapsulation {data[:2].hex(' ')}; 00 00 or 00 01 is required")
    order = "<" if data[1] else ">"
    sec, nanosec, length = _HEAD[order].unpack_from(data, _ENCAPSULATION_SIZE)
    if sec < 0 or nanosec >= NANOSECONDS:
        raise MalformedMessage(f"stamp of {sec} s and {nanosec} ns is not a time")
    return order, sec * NANOSECONDS + nanosec, _HEAD_SIZE + length


def _unpack_vectors(data: bytes) -> tuple[str, int, int]:
    """Return byte order, stamp [ns] and where the two Vector3 of an Accel or a Wrench begin."""
    order, stamp_ns, end = _unpack_head(data)
    body = _ENCAPSULATION_SIZE + ((end + 7) & ~7)
    if len(data) < body + _VECTORS_SIZE:
        raise MalformedMessage(f"{len(data)} bytes; at least {body + _VECTORS_SIZE} are required")
    return order, stamp_ns, body


def _head_constants(text: bytes) -> bytes:
    """Return length and text of frame_id; `Struct` pads them with zeros up to what comes next."""
    return len(text).to_bytes(4, "little") + text


def _aligned(size: int, alignment: int = 8) -> int:
    return -(-size // alignment) * alignment


def _stamp_problem(stamp_ns: int) -> str:
    return f"stamp {stamp_ns} ns does not fit in a ROS time; 0 to {_MAX_STAMP_NS - 1} is required"
