"""The command packet as the documentation has it, with velocity and displacement where they are asked for."""

import math
import struct
import zlib

import numpy as np
import pytest
from scipy import signal

from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.wire import Kind, decode_host_packet
from tests.nodes.scripted_controller import REAL_TIME, answer_to


def expected_command(data, step, acceleration, velocity, displacement):
    """Return the bytes of a command, with sequence and session of a datagram, as the documentation has them."""
    sequence, session = struct.unpack_from("<I", data, 8)[0], struct.unpack_from("<I", data, 48)[0]
    time_ns = REAL_TIME.run.stamps.of(step)
    body = struct.pack(
        "<4sHHIIqdddI", b"RTHC", 1, 2, sequence, step, time_ns, acceleration, velocity, displacement, session
    )
    return body + struct.pack("<I", zlib.crc32(body))


def sent_commands(script):
    return [data for data in script.datagrams if decode_host_packet(data).kind is Kind.COMMAND]


def test_velocity_and_displacement_are_nan_unless_they_are_asked_for(scripted):
    table, script = scripted(lambda p: [answer_to(p)])
    table.exchange(TableCommand(0, 1.5))
    (data,) = sent_commands(script)
    assert data == expected_command(data, 0, 1.5, math.nan, math.nan)


def test_velocity_and_displacement_are_the_filtered_integrals_also_over_skipped_steps(scripted):
    table, script = scripted(lambda p: [answer_to(p)], REAL_TIME.changed(table__send_displacement=True))
    corner, dt = REAL_TIME.safety.high_pass_frequency, REAL_TIME.run.time_step
    denominator = [1.0, 2.0 * corner, 2.0 * corner**2, corner**3]
    held = np.array([1.0, -2.0, -2.0, -2.0, 0.5])
    steps = (0, 1, 4)
    velocity, displacement = (
        signal.dlsim(signal.TransferFunction(numerator, denominator).to_ss().to_discrete(dt), np.append(held, 0.0))[1]
        for numerator in ([1.0, 0.0, 0.0], [1.0, 0.0])
    )
    for _ in range(2):  # a new test begins at rest
        table.connect()
        script.datagrams.clear()
        for step in steps:
            table.exchange(TableCommand(step, held[step]))
        for step, data in zip(steps, sent_commands(script), strict=True):
            packet = decode_host_packet(data)
            assert packet.velocity == pytest.approx(velocity[step + 1, 0], rel=1e-9)
            assert packet.displacement == pytest.approx(displacement[step + 1, 0], rel=1e-9)
            assert data == expected_command(data, step, held[step], packet.velocity, packet.displacement)
