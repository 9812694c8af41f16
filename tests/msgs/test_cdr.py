"""The codecs write what rclpy and rosbags write, read what they may send, and refuse everything else."""

from __future__ import annotations

import math
import random
import struct
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import AccelStamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.cdr import MalformedMessage, MeasurementCodec, PairCodec, ScalarCodec, count_floors
from bmd_rths_msgs_py.topics import ACCELERATION_TYPE, FORCE_TYPE, MEASUREMENT_TYPE

FRAMES = ["", "a", "ab", "abc", "abcd", "world", "interface", "a_very_long_frame_id/with/é", "x" * 300]
TIME_STEP_NS = 5_000_000
STAMPS = StepStamps(0.005)
STAMP = 1_234 * TIME_STEP_NS + 3 * 1_000_000_000
DOUBLES = st.floats(allow_nan=True, allow_infinity=True)


def measurement(floors: int) -> TableMeasurement:
    return TableMeasurement(STAMP // TIME_STEP_NS, 1.5, -2.5, 3.5, -4.5, 5.5, np.arange(floors) + 0.25)


def ros_scalar(type_name: str, frame: str, value: float) -> Any:
    message = AccelStamped() if type_name == ACCELERATION_TYPE else WrenchStamped()
    if isinstance(message, AccelStamped):
        message.accel.linear.x = value
    else:
        message.wrench.force.x = value
    set_header(message, frame)
    return message


def ros_measurement(frame: str, floors: int) -> JointTrajectory:
    m = measurement(floors)
    nan = math.nan
    message = JointTrajectory()
    set_header(message, frame)
    message.joint_names = ["table", *(f"floor_{i + 1}" for i in range(floors)), "applied_command"]
    point = JointTrajectoryPoint()
    point.positions = [m.table_displacement] + [nan] * (floors + 1)
    point.accelerations = [m.table_acceleration, *m.floor_accelerations.tolist(), m.applied_command]
    point.effort = [m.actuator_force, m.base_shear] + [nan] * floors
    message.points = [point]
    return message


def set_header(message: Any, frame: str) -> None:
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(STAMP, 1_000_000_000)


def rosbags_bytes(typestore: Any, type_name: str, data: bytes) -> bytes:
    return bytes(typestore.serialize_cdr(typestore.deserialize_cdr(data, type_name), type_name))


def without_padding(typestore: Any, type_name: str, data: bytes, other: bytes) -> bytes:
    """Return `other` with the bytes replaced that rosbags does not see in `data`, and cut to its length.

    rclpy leaves padding uninitialised and may append bytes, so only the rest can be compared.
    """
    plain = rosbags_bytes(typestore, type_name, data)
    result = bytearray(other[: len(data)])
    for i in range(4, len(data)):
        changed = bytearray(data)
        changed[i] ^= 0x01
        try:
            if rosbags_bytes(typestore, type_name, bytes(changed)) == plain:
                result[i] = data[i]
        except Exception:  # whatever rosbags makes of a changed length or text: certainly no padding
            continue
    return bytes(result)


def equal(a: TableMeasurement, b: TableMeasurement) -> bool:
    return np.array_equal(np.hstack(a), np.hstack(b), equal_nan=True)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("type_name", [ACCELERATION_TYPE, FORCE_TYPE])
class TestScalar:
    def test_bytes_are_those_of_rosbags(self, typestore: Any, type_name: str, frame: str) -> None:
        data = ScalarCodec(frame).pack(STAMP, -1.5)
        assert data == rosbags_bytes(typestore, type_name, data)

    def test_bytes_are_those_of_rclpy(self, typestore: Any, type_name: str, frame: str) -> None:
        data = ScalarCodec(frame).pack(STAMP, -1.5)
        message = ros_scalar(type_name, frame, -1.5)
        assert deserialize_message(data, type(message)) == message
        assert data == without_padding(typestore, type_name, data, serialize_message(message))

    def test_reads_rclpy(self, type_name: str, frame: str) -> None:
        data = serialize_message(ros_scalar(type_name, frame, -1.5))
        assert ScalarCodec("other").unpack(data) == (STAMP, -1.5)

    def test_reads_either_byte_order(self, typestore: Any, type_name: str, frame: str) -> None:
        message = typestore.deserialize_cdr(ScalarCodec(frame).pack(STAMP, -1.5), type_name)
        data = bytes(typestore.serialize_cdr(message, type_name, little_endian=False))
        assert data[:2] == b"\x00\x00"
        assert ScalarCodec().unpack(data) == (STAMP, -1.5)


@pytest.mark.parametrize("floors", [1, 2, 3, 12])
@pytest.mark.parametrize("frame", FRAMES)
class TestMeasurement:
    def test_bytes_are_those_of_rosbags(self, typestore: Any, frame: str, floors: int) -> None:
        data = MeasurementCodec(floors, STAMPS, frame).pack(STAMP, measurement(floors))
        assert data == rosbags_bytes(typestore, MEASUREMENT_TYPE, data)

    def test_bytes_are_those_of_rclpy(self, typestore: Any, frame: str, floors: int) -> None:
        data = MeasurementCodec(floors, STAMPS, frame).pack(STAMP, measurement(floors))
        message = ros_measurement(frame, floors)
        assert repr(deserialize_message(data, JointTrajectory)) == repr(message)  # NaN is not equal to itself
        assert data == without_padding(typestore, MEASUREMENT_TYPE, data, serialize_message(message))

    def test_reads_rclpy(self, frame: str, floors: int) -> None:
        data = serialize_message(ros_measurement(frame, floors))
        assert count_floors(data) == floors
        stamp, found = MeasurementCodec(floors, STAMPS, "other").unpack(data)
        assert stamp == STAMP
        assert found.step == STAMP // TIME_STEP_NS
        assert equal(found, measurement(floors))

    def test_reads_either_byte_order(self, typestore: Any, frame: str, floors: int) -> None:
        codec = MeasurementCodec(floors, STAMPS, frame)
        message = typestore.deserialize_cdr(codec.pack(STAMP, measurement(floors)), MEASUREMENT_TYPE)
        data = bytes(typestore.serialize_cdr(message, MEASUREMENT_TYPE, little_endian=False))
        assert data[:2] == b"\x00\x00"
        assert count_floors(data) == floors
        assert equal(codec.unpack(data)[1], measurement(floors))


@pytest.mark.slow
@given(stamp=st.integers(0, 2**31 * 10**9 - 1), value=DOUBLES, frame=st.text(max_size=20))
def test_scalar_round_trip(stamp: int, value: float, frame: str) -> None:
    codec = ScalarCodec(frame)
    found, number = codec.unpack(codec.pack(stamp, value))
    assert found == stamp
    assert struct.pack("d", number) == struct.pack("d", value)


@given(step=st.integers(0, 10**9), values=st.lists(DOUBLES, min_size=6, max_size=20))
def test_measurement_round_trip(step: int, values: list[float]) -> None:
    codec = MeasurementCodec(len(values) - 5, STAMPS, "world")
    given_measurement = TableMeasurement(step, *values[:5], np.array(values[5:]))
    stamp, found = codec.unpack(codec.pack(step * TIME_STEP_NS, given_measurement))
    assert stamp == step * TIME_STEP_NS
    assert found.step == step
    assert np.hstack(found).tobytes() == np.hstack(given_measurement).tobytes()


@pytest.mark.parametrize("stamp", [-1, 2**31 * 10**9])
def test_a_stamp_that_is_no_ros_time_is_not_packed(stamp: int) -> None:
    with pytest.raises(ValueError, match=str(stamp)):
        ScalarCodec().pack(stamp, 0.0)
    with pytest.raises(ValueError, match=str(stamp)):
        MeasurementCodec(3, STAMPS).pack(stamp, measurement(3))


def test_the_wrong_number_of_floors_is_not_packed() -> None:
    with pytest.raises(ValueError, match="4 floors"):
        MeasurementCodec(3, STAMPS).pack(STAMP, measurement(4))


def test_a_codec_needs_a_floor() -> None:
    with pytest.raises(ValueError, match="0 floors"):
        MeasurementCodec(0, STAMPS)


def test_more_bytes_behind_a_message_are_ignored() -> None:
    codec = MeasurementCodec(2, STAMPS)
    assert ScalarCodec().unpack(ScalarCodec().pack(STAMP, 2.0) + b"\xff" * 9) == (STAMP, 2.0)
    assert equal(codec.unpack(codec.pack(STAMP, measurement(2)) + b"\xff" * 9)[1], measurement(2))


def test_every_truncation_is_malformed() -> None:
    scalar = ScalarCodec("world")
    codec = MeasurementCodec(3, STAMPS, "world")
    for unpack, data in (
        (scalar.unpack, scalar.pack(STAMP, 1.0)),
        (codec.unpack, codec.pack(STAMP, measurement(3))),
    ):
        for length in range(len(data)):
            with pytest.raises(MalformedMessage):
                unpack(data[:length])


@pytest.mark.parametrize("head", [b"\x00\x02", b"\x00\x03", b"\x01\x01", b"\x00\x07", b"\xff\xff"])
def test_other_encapsulations_are_malformed(head: bytes) -> None:
    with pytest.raises(MalformedMessage, match="encapsulation"):
        ScalarCodec().unpack(head + ScalarCodec().pack(STAMP, 1.0)[2:])


@pytest.mark.parametrize(("sec", "nanosec"), [(-1, 0), (0, 1_000_000_000), (0, 2**32 - 1)])
def test_stamps_that_are_no_time_are_malformed(sec: int, nanosec: int) -> None:
    data = bytearray(ScalarCodec().pack(0, 1.0))
    struct.pack_into("<iI", data, 4, sec, nanosec)
    with pytest.raises(MalformedMessage, match="not a time"):
        ScalarCodec().unpack(bytes(data))


def test_a_measurement_between_steps_is_malformed() -> None:
    codec = MeasurementCodec(3, STAMPS)
    with pytest.raises(MalformedMessage, match="not that of a step"):
        codec.unpack(codec.pack(STAMP + 1, measurement(3)))


def wrong_measurements() -> dict[str, JointTrajectory]:
    """Well-formed trajectories that are no measurement of three floors."""
    wrong = {name: ros_measurement("world", 3) for name in ("name", "order", "no point", "two points", "velocities")}
    wrong["name"].joint_names[1] = "floor_9"
    wrong["order"].joint_names = [*wrong["order"].joint_names[::-1]]
    wrong["no point"].points = []
    wrong["two points"].points = wrong["two points"].points * 2
    wrong["velocities"].points[0].velocities = [0.0] * 5
    for field in ("positions", "accelerations", "effort"):
        for change in (-1, 1):
            message = ros_measurement("world", 3)
            values = list(getattr(message.points[0], field))
            setattr(message.points[0], field, values[:-1] if change < 0 else [*values, 0.0])
            wrong[f"{field} {change:+d}"] = message
    wrong["no joints"] = JointTrajectory()
    wrong["more floors"] = ros_measurement("world", 4)
    wrong["fewer floors"] = ros_measurement("world", 2)
    return wrong


@pytest.mark.parametrize("what", wrong_measurements())
def test_other_trajectories_are_malformed(what: str) -> None:
    with pytest.raises(MalformedMessage):
        MeasurementCodec(3, STAMPS).unpack(serialize_message(wrong_measurements()[what]) + bytes(100))


@pytest.mark.parametrize("joints", [0, 1, 2, 20, 2**31, 2**32 - 1])
def test_impossible_numbers_of_joints_are_malformed(joints: int) -> None:
    data = bytearray(MeasurementCodec(3, STAMPS, "abc").pack(STAMP, measurement(3)))
    struct.pack_into("<I", data, 20, joints)
    with pytest.raises(MalformedMessage):
        count_floors(bytes(data))


def mutated(rng: random.Random, packets: list[bytes]) -> bytes:
    """Return random bytes, or a packet with a few bytes changed, cut or put in."""
    if rng.random() < 0.1:
        return rng.randbytes(rng.randrange(400))
    data = bytearray(rng.choice(packets))
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(data) + 1)
        kind = rng.randrange(4)
        if kind == 0:
            data[at : at + 1] = rng.randbytes(1)
        elif kind == 1:
            data[at : at + 4] = rng.choice((b"\xff\xff\xff\xff", b"\x00\x00\x00\x80", b"\x00\x00\x00\x00"))
        elif kind == 2:
            del data[at:]
        else:
            data[at:at] = rng.randbytes(rng.randrange(9))
    return bytes(data)


@pytest.mark.slow
def test_fuzz() -> None:
    """200,000 damaged packets give a valid value or `MalformedMessage`, never anything else."""
    rng = random.Random(1)
    scalar = ScalarCodec("world")
    codec = MeasurementCodec(3, STAMPS, "world")
    packets = [scalar.pack(STAMP, 1.0), ScalarCodec().pack(0, 0.0), codec.pack(STAMP, measurement(3))]
    packets += [b"\x00\x00" + packet[2:] for packet in packets]
    good = malformed = 0
    for _ in range(200_000):
        data = mutated(rng, packets)
        for unpack in (scalar.unpack, codec.unpack, count_floors):
            try:
                value = unpack(data)
            except MalformedMessage:
                malformed += 1
                continue
            good += 1
            if unpack == count_floors:
                assert 1 <= value <= len(data)
            else:
                stamp, content = value
                assert 0 <= stamp < 2**31 * 10**9
                assert isinstance(content, float) or content.floor_accelerations.shape == (3,)
    assert good > 10_000
    assert malformed > 10_000


@pytest.mark.parametrize("frame", FRAMES)
def test_pair_is_read_by_ros_and_its_first_number_as_a_scalar(frame: str) -> None:
    data = PairCodec(frame).pack(STAMP, (1.5, -2.5))
    message = deserialize_message(data, AccelStamped)
    assert (message.accel.linear.x, message.accel.linear.y, message.accel.linear.z) == (1.5, -2.5, 0.0)
    assert message.accel.angular.z == 0.0
    assert (message.header.frame_id, ScalarCodec().unpack(data)) == (frame, (STAMP, 1.5))
    assert PairCodec().unpack(serialize_message(message)) == (STAMP, (1.5, -2.5))
    with pytest.raises(MalformedMessage, match="at least"):
        PairCodec().unpack(data[:-1])
