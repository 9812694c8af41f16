"""UDP wire format: packets as lists of (packet, bytes) written by hand, and everything that is no packet."""

import math
import runpy
import struct
from pathlib import Path
from zlib import crc32

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bmd_rths_core.table.wire import (
    CONTROLLER_LENGTH,
    HOST_LENGTH,
    ControllerPacket,
    ControllerState,
    HostPacket,
    Interlock,
    Kind,
    Rejection,
    decode_controller_packet,
    decode_host_packet,
    encode_controller_packet,
    encode_host_packet,
    interlock_names,
)

NAN = math.nan

#: Fields in the order of the format: magic, version, kind, sequence, step, time, three commands, session, CRC.
HOST = [
    (
        HostPacket(Kind.COMMAND, 7, 3, 15_000_000, 1.5, NAN, NAN, 0x12345678),
        "52544843 0100 0200 07000000 03000000 c0e1e40000000000"
        "000000000000f83f 000000000000f87f 000000000000f87f 78563412 36c04c74",
    ),
    (
        HostPacket(Kind.ARM, 2**32 - 1, 1, 0, 0.0, NAN, NAN, 2**32 - 1),
        "52544843 0100 0100 ffffffff 01000000 0000000000000000"
        "0000000000000000 000000000000f87f 000000000000f87f ffffffff c9d6294d",
    ),
]

#: Magic, version, state, sequence, step, interlock, n, reserved, clock, four sensors, n floors, session, CRC.
CONTROLLER = [
    (
        ControllerPacket(
            ControllerState.RUNNING, 7, 3, Interlock(0), 1_000_000_000, 3.0, -0.5, 100.0, NAN, (1.0, 2.0), 0x12345678
        ),
        "5254484d 0100 0200 07000000 03000000 00000000 0200 0000 00ca9a3b00000000"
        "0000000000000840 000000000000e0bf 0000000000005940 000000000000f87f"
        "000000000000f03f 0000000000000040 78563412 59444516",
    ),
    (
        ControllerPacket(
            *(ControllerState.INTERLOCK, 8, 3, Interlock.WATCHDOG | Interlock.EMERGENCY_STOP),
            *(0, 0.0, 0.0, 0.0, 0.0, (), 0x12345678),
        ),
        "5254484d 0100 0400 08000000 03000000 30000000 0000 0000 0000000000000000"
        "0000000000000000 0000000000000000 0000000000000000 0000000000000000 78563412 fccf29f0",
    ),
]

COMMAND = bytes.fromhex(HOST[0][1])
ANSWER = bytes.fromhex(CONTROLLER[0][1])


def sealed(data):
    """Return the bytes with a right CRC in place of their last four."""
    return data[:-4] + struct.pack("<I", crc32(data[:-4]))


def changed(data, offset, new):
    return sealed(data[:offset] + new + data[offset + len(new) :])


def test_lengths_are_those_of_the_format():
    assert (HOST_LENGTH, CONTROLLER_LENGTH) == (56, 72)


@pytest.mark.parametrize(("packet", "text"), HOST)
def test_host_packets(packet, text):
    data = bytes.fromhex(text)
    assert encode_host_packet(packet) == data
    assert repr(decode_host_packet(data)) == repr(packet)  # NaN is not equal to itself
    assert data == sealed(data)


@pytest.mark.parametrize(("packet", "text"), CONTROLLER)
def test_controller_packets(packet, text):
    data = bytes.fromhex(text)
    assert encode_controller_packet(packet) == data
    assert repr(decode_controller_packet(data, len(packet.floor_accelerations))) == repr(packet)
    assert data == sealed(data)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", Rejection.LENGTH),
        (COMMAND[:-1], Rejection.LENGTH),
        (COMMAND + b"\0", Rejection.LENGTH),
        (changed(COMMAND, 0, b"RTHM"), Rejection.MAGIC),
        (changed(COMMAND, 4, b"\2\0"), Rejection.VERSION),
        (COMMAND[:-1] + b"\0", Rejection.CRC),
        (changed(COMMAND, 6, b"\6\0"), Rejection.CONTENT),
        (changed(COMMAND, 24, struct.pack("<d", NAN)), Rejection.CONTENT),
        (changed(COMMAND, 24, struct.pack("<d", -math.inf)), Rejection.CONTENT),
        (changed(bytes.fromhex(HOST[1][1]), 12, b"\2"), Rejection.CONTENT),
    ],
)
def test_wrong_host_packets_are_rejected(data, reason):
    assert decode_host_packet(data) is reason


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", Rejection.LENGTH),
        (ANSWER[:-8], Rejection.LENGTH),
        (COMMAND, Rejection.LENGTH),
        (changed(ANSWER, 0, b"RTHC"), Rejection.MAGIC),
        (changed(ANSWER, 4, b"\0\1"), Rejection.VERSION),
        (changed(ANSWER, 10, b"\1")[:-1] + b"\0", Rejection.CRC),
        (changed(ANSWER, 6, b"\5\0"), Rejection.CONTENT),
        (changed(ANSWER, 16, b"\0\1"), Rejection.CONTENT),
        (changed(ANSWER, 20, b"\3\0"), Rejection.CONTENT),
        (changed(ANSWER, 22, b"\1\0"), Rejection.CONTENT),
    ],
)
def test_wrong_controller_packets_are_rejected(data, reason):
    assert decode_controller_packet(data, 2) is reason


def test_answer_with_another_number_of_floors_is_rejected():
    assert decode_controller_packet(ANSWER, 1) is Rejection.LENGTH
    assert decode_controller_packet(ANSWER, 3) is Rejection.LENGTH


def test_answer_becomes_the_measurement_of_its_step():
    measurement = CONTROLLER[0][0].measurement(1.5)
    assert measurement[:3] == (3, 1.5, 3.0)
    assert measurement[3:5] == (-0.5, 100.0)
    assert math.isnan(measurement.base_shear)
    assert measurement.floor_accelerations.tolist() == [1.0, 2.0]


def test_interlock_in_words():
    assert interlock_names(Interlock.WATCHDOG | Interlock.DISPLACEMENT) == "displacement, watchdog"
    assert interlock_names(Interlock(32)) == "emergency stop"
    assert interlock_names(Interlock(0)) == "no reason given"


@given(
    *(st.sampled_from(Kind), st.integers(0, 2**32 - 1), st.integers(0, 1), st.integers(-(2**63), 2**63 - 1)),
    *(st.floats(allow_nan=False, allow_infinity=False), st.floats(), st.integers(0, 2**32 - 1)),
)
def test_every_host_packet_survives_the_way(kind, sequence, step, time, acceleration, displacement, session):
    packet = HostPacket(kind, sequence, step, time, acceleration, NAN, displacement, session)
    assert repr(decode_host_packet(encode_host_packet(packet))) == repr(packet)


@given(st.binary(max_size=200))
def test_random_bytes_are_rejected(data):
    assert isinstance(decode_host_packet(data), Rejection)
    assert isinstance(decode_controller_packet(data, 2), Rejection)


@given(st.integers(0, 8 * len(COMMAND) - 1), st.integers(0, 31))
def test_up_to_32_wrong_bits_in_a_row_are_always_found(first, length):
    """A CRC of 32 bits finds every burst of that length."""
    for data, decode in ((COMMAND, decode_host_packet), (ANSWER, lambda d: decode_controller_packet(d, 2))):
        wrong = int.from_bytes(data, "little")
        wrong ^= 1 << first
        if length:
            wrong ^= 1 << min(first + length, 8 * len(data) - 1)
        mutated = wrong.to_bytes(len(data), "little")
        assert isinstance(decode(mutated), Rejection) or mutated == data


@given(st.data())
def test_mutated_packet_with_a_right_crc_is_decoded_as_a_whole_or_rejected(data):
    """Whatever the fields hold: what is accepted encodes to the same bytes again."""
    for original, decode, encode in (
        (COMMAND, decode_host_packet, encode_host_packet),
        (ANSWER, lambda d: decode_controller_packet(d, 2), encode_controller_packet),
    ):
        mutated = bytearray(original)
        for offset in data.draw(st.lists(st.integers(0, len(original) - 5), max_size=4)):
            mutated[offset] = data.draw(st.integers(0, 255))
        packet = decode(sealed(bytes(mutated)))
        assert isinstance(packet, Rejection) or encode(packet) == sealed(bytes(mutated))


@pytest.mark.parametrize("name", ["host", "controller"])
def test_ten_thousand_mutations_are_judged_as_by_a_second_description_of_the_format(name):
    """The benchmark does the same with a million."""
    benchmark = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "wire_fuzz.py"))
    result = benchmark["fuzz"](name, 10_000, 3, benchmark["Progress"](disable=True))
    assert (result["wrongly judged"], result["exceptions"]) == (0, 0)
    assert result["accepted"] > 500
