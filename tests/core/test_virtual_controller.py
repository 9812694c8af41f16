"""Virtual table controller: sessions, lockstep, real time, watchdog and interlocks, packet by packet."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_virtual_controller
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.emulated.faults import Fault, Faults, FaultyNetwork, parse_fault
from bmd_rths_core.table.emulated.return_to_rest import at_rest, return_acceleration
from bmd_rths_core.table.emulated.virtual_controller import SESSION_SILENCE, SUBSTEP
from bmd_rths_core.table.models.simulated import SimulatedTable
from bmd_rths_core.table.wire import (
    ArmMode,
    ControllerState,
    HostPacket,
    Interlock,
    Kind,
    decode_controller_packet,
    encode_host_packet,
)

MS = 1_000_000
HOST, STRANGER = ("127.0.0.1", 1), ("127.0.0.1", 2)
CONFIG = Config().changed(virtual_controller__model="servo")


class Bench:
    """A controller, a clock and a host that numbers its packets."""

    def __init__(self, config=CONFIG, faults=()):
        self.faults = Faults(parse_fault(text) for text in faults)
        self.controller = make_virtual_controller(config, self.faults)
        self.now = 10_000 * MS
        self.sequence = 0

    def send(self, kind, step=0, acceleration=0.0, session=5, sender=HOST, sequence=None):
        """Send a packet and return the answers that are due at once."""
        if sequence is None:
            sequence = self.sequence
            self.sequence += 1
        packet = HostPacket(kind, sequence, step, 0, acceleration, math.nan, math.nan, session)
        self.controller.receive(encode_host_packet(packet), sender, self.now)
        return self.answers()

    def answers(self):
        return [decode_controller_packet(answer.data, 2) for answer in self.controller.answers()]

    def wait(self, milliseconds):
        self.now += round(milliseconds * MS)
        self.controller.advance(self.now)
        return self.answers()

    def armed(self, mode=ArmMode.REAL_TIME):
        (answer,) = self.send(Kind.ARM, mode)
        assert answer.state is ControllerState.ARMED
        return self

    def run(self, commands, first=0):
        """Run real time with one command every 5 ms and return the answers."""
        found = []
        for step, command in enumerate(commands, start=first):
            found += self.send(Kind.COMMAND, step, command)
            found += self.wait(5.0)
        return found

    @property
    def state(self):
        return self.controller.state


def sine(steps, amplitude=1.0):
    return amplitude * np.cos(2 * np.pi * 1.5 * np.arange(steps) * 0.005)


def test_status_is_answered_in_every_state_with_the_sequence_and_the_session():
    bench = Bench()
    (answer,) = bench.send(Kind.STATUS, sequence=77, session=9)
    assert (answer.state, answer.sequence, answer.session) == (ControllerState.IDLE, 77, 9)
    assert math.isnan(answer.acceleration)  # nothing has been measured


def test_lockstep_is_the_simulated_table_bit_for_bit_also_when_steps_are_skipped():
    bench = Bench().armed(ArmMode.LOCKSTEP)
    table = SimulatedTable(CONFIG.simulated_table, CONFIG.specimen.building(), 0.005, CONFIG.run.seed)
    for step in (0, 1, 2, 5, 6, 9):
        command = math.sin(step)
        (answer,) = bench.send(Kind.COMMAND, step, command)
        expected = table.exchange(TableCommand(step, command))
        found = answer.measurement(command)
        assert found[:6] == expected[:6]
        assert np.array_equal(found.floor_accelerations, expected.floor_accelerations)
        assert answer.state is ControllerState.RUNNING


def test_repeated_packet_is_answered_again_and_does_nothing_twice():
    bench, once = Bench().armed(ArmMode.LOCKSTEP), Bench().armed(ArmMode.LOCKSTEP)
    (first,) = bench.send(Kind.COMMAND, 0, 1.0, sequence=10)
    (again,) = bench.send(Kind.COMMAND, 0, 1.0, sequence=10)
    assert repr(again) == repr(first)
    once.send(Kind.COMMAND, 0, 1.0, sequence=10)
    (second,) = bench.send(Kind.COMMAND, 1, 0.5, sequence=11)
    (expected,) = once.send(Kind.COMMAND, 1, 0.5, sequence=11)
    assert repr(second._replace(clock=0)) == repr(expected._replace(clock=0))
    assert bench.send(Kind.COMMAND, 0, 1.0, sequence=10) == []  # overtaken on the way
    assert (bench.controller.counts["duplicate"], bench.controller.counts["old"]) == (1, 1)


def test_sequence_wraps():
    bench = Bench()
    bench.send(Kind.ARM, ArmMode.LOCKSTEP, sequence=2**32 - 2)
    for step, sequence in enumerate((2**32 - 1, 0, 1)):
        (answer,) = bench.send(Kind.COMMAND, step, sequence=sequence)
        assert (answer.step, answer.sequence) == (step, sequence)


def test_real_time_answers_3_ms_after_the_command_with_the_sensors_of_that_moment():
    quiet = CONFIG.changed(simulated_table__acceleration_noise=0.0, simulated_table__shear_noise=0.0)
    bench = Bench(quiet).armed()
    assert bench.send(Kind.COMMAND, 0, 2.0) == []
    assert bench.wait(2.9) == []
    (answer,) = bench.wait(0.2)
    assert (answer.step, answer.state) == (0, ControllerState.RUNNING)
    table = SimulatedTable(quiet.simulated_table, quiet.specimen.building(), SUBSTEP * 1e-9, 0)
    for substep in range(round(3 * MS / SUBSTEP)):
        expected = table.exchange(TableCommand(substep, 2.0))
    assert answer.measurement(2.0)[2:6] == expected[2:6]


def test_table_follows_the_commands_in_real_time():
    bench = Bench().armed()
    answers = bench.run(sine(200))
    assert [answer.step for answer in answers] == list(range(200))
    displacements = [answer.displacement for answer in answers]
    assert max(displacements) == pytest.approx(2.0 / (2 * np.pi * 1.5) ** 2, rel=0.1)


def test_stop_ramps_to_rest_without_an_offset():
    bench = Bench().armed()
    bench.run(sine(30))
    (answer,) = bench.send(Kind.STOP)
    assert answer.state is ControllerState.STOPPING
    found = []
    while bench.state is ControllerState.STOPPING:
        bench.wait(5.0)
        found += bench.send(Kind.STATUS)
        assert len(found) < 10.0 / CONFIG.virtual_controller.return_frequency / 0.005 * 2
    last = found[-1]
    assert last.state is ControllerState.IDLE
    assert abs(last.displacement) < 1e-4
    assert abs(last.acceleration) < 0.3  # noise


def test_silent_host_trips_the_watchdog_and_the_table_returns_to_rest():
    bench = Bench().armed()
    bench.wait(1000.0)  # armed, it may take its time
    bench.run(sine(30))
    bench.wait(44.0)
    assert bench.state is ControllerState.RUNNING
    bench.wait(3.0)
    assert (bench.state, bench.controller.interlock) == (ControllerState.INTERLOCK, Interlock.WATCHDOG)
    (answer,) = bench.send(Kind.COMMAND, 31, 1.0)
    assert (answer.state, answer.step) == (ControllerState.INTERLOCK, 29)
    bench.wait(5000.0)
    (answer,) = bench.send(Kind.STATUS)
    assert abs(answer.displacement) < 1e-4
    (answer,) = bench.send(Kind.ARM)
    assert answer.state is ControllerState.INTERLOCK  # latched
    (answer,) = bench.send(Kind.RESET)
    assert (answer.state, answer.interlock) == (ControllerState.IDLE, Interlock(0))
    bench.armed()


def test_reset_waits_until_the_table_is_at_rest():
    bench = Bench().armed()
    bench.run(sine(30))
    (answer,) = bench.send(Kind.EMERGENCY_STOP)
    assert (answer.state, answer.interlock) == (ControllerState.INTERLOCK, Interlock.EMERGENCY_STOP)
    (answer,) = bench.send(Kind.RESET)
    assert answer.state is ControllerState.INTERLOCK


def test_time_stands_still_in_lockstep_so_there_is_no_watchdog():
    bench = Bench().armed(ArmMode.LOCKSTEP)
    bench.send(Kind.COMMAND, 0, 1.0)
    bench.wait(10_000.0)
    assert bench.state is ControllerState.RUNNING
    (answer,) = bench.send(Kind.STOP)
    assert answer.state is ControllerState.IDLE
    assert abs(answer.displacement) < 1e-4


@pytest.mark.parametrize(
    ("limit", "value", "bit"),
    [
        ("displacement", 1e-3, Interlock.DISPLACEMENT),
        ("velocity", 0.01, Interlock.VELOCITY),
        ("acceleration", 0.4, Interlock.ACCELERATION),
        ("force", 1e3, Interlock.FORCE),
        ("tracking", 1e-4, Interlock.TRACKING),
    ],
)
def test_every_limit_has_its_interlock(limit, value, bit):
    bench = Bench(CONFIG.changed(**{f"virtual_controller__{limit}_limit": value})).armed()
    bench.run(sine(100))
    assert bench.state is ControllerState.INTERLOCK
    assert bench.controller.interlock & bit
    bench.run([1.0] * 100, first=100)  # the host does not listen
    for _ in range(800):
        bench.wait(5.0)
    (answer,) = bench.send(Kind.STATUS)
    assert abs(answer.displacement) < 1e-4


def test_command_of_a_step_that_has_passed_is_an_interlock():
    bench = Bench().armed()
    bench.run(sine(3))
    (answer,) = bench.send(Kind.COMMAND, 1, 0.0)
    assert (answer.state, answer.interlock) == (ControllerState.INTERLOCK, Interlock.BAD_PACKET)


def test_second_host_is_refused_while_the_first_is_heard():
    bench = Bench().armed()
    bench.run(sine(3))
    assert bench.send(Kind.STATUS, session=6, sender=STRANGER) == []
    assert bench.send(Kind.COMMAND, 3, 9.0, session=5, sender=STRANGER) == []
    assert bench.send(Kind.EMERGENCY_STOP, session=6) == []
    counts = bench.controller.counts
    assert (counts["wrong_session"], counts["wrong_address"]) == (2, 1)
    assert bench.state is ControllerState.RUNNING


def test_armed_host_that_asks_for_the_status_keeps_its_session():
    bench = Bench().armed()
    for _ in range(12):
        bench.wait(0.25 * SESSION_SILENCE / MS)
        (answer,) = bench.send(Kind.STATUS)
        assert answer.state is ControllerState.ARMED
        assert bench.send(Kind.STATUS, session=6, sender=STRANGER) == []
    assert bench.run([1.0])[-1].state is ControllerState.RUNNING


def test_host_that_has_gone_loses_its_session():
    bench = Bench().armed()
    assert bench.send(Kind.STATUS, session=6) == []
    bench.wait(SESSION_SILENCE / MS + 1)
    (answer,) = bench.send(Kind.STATUS, session=6)
    assert answer.state is ControllerState.IDLE
    assert bench.send(Kind.COMMAND, 0, 1.0, session=5) == [] or bench.state is ControllerState.IDLE


@given(st.lists(st.tuples(st.sampled_from(Kind), st.integers(0, 5), st.integers(0, 30)), max_size=30))
@settings(max_examples=50, deadline=None)
def test_whatever_a_host_sends_the_table_ends_at_rest(packets):
    bench = Bench()
    for kind, step, milliseconds in packets:
        bench.send(kind, min(step, 1) if kind is Kind.ARM else step, 1.0)
        bench.wait(milliseconds)
    bench.send(Kind.STOP)
    for _ in range(800):
        bench.wait(5.0)
    assert bench.state in (ControllerState.IDLE, ControllerState.INTERLOCK)
    assert abs(bench.controller.motion.displacement) < 1e-4  # the true one: a sensor has noise of half of that


def test_hydraulic_table_comes_to_rest_after_a_stop():
    bench = Bench(Config()).armed()
    bench.run(sine(30))
    bench.send(Kind.STOP)
    for _ in range(800):
        bench.wait(5.0)
    (answer,) = bench.send(Kind.STATUS)
    assert answer.state is ControllerState.IDLE
    assert abs(answer.displacement) < 2e-4


# ---- faults


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("loss", Fault("loss", 10.0, 0)),
        ("loss=2.5", Fault("loss", 2.5, 0)),
        ("frozen@200", Fault("frozen", 0.0, 200)),
        ("valve=20@1000", Fault("valve", 20.0, 1000)),
        ("stuck=force", Fault("stuck", 2.0, 0)),
        ("stuck=floor_2@3", Fault("stuck", 5.0, 3)),
    ],
)
def test_faults_are_read(text, fault):
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("los", "fault 'los': NAME[=VALUE][@STEP] with one of loss, delay"),
        ("loss=200", "'200' is not allowed; 0 to 100 % is required"),
        ("loss=nan", "'nan' is not allowed; 0 to 100 % is required"),
        ("delay=x", "'x' is not allowed; 0 to 10000 ms is required"),
        ("dead=1", "'1' is not allowed; no value is required"),
        ("stuck=nose", "'nose' is no sensor; one of acceleration, displacement, force, shear, floor_1"),
        ("loss=1@-3", "NAME[=VALUE][@STEP]"),
        ("", "NAME[=VALUE][@STEP]"),
    ],
)
def test_what_is_no_fault_is_refused(text, message):
    with pytest.raises(InputError) as error:
        parse_fault(text)
    assert message in str(error.value)


def test_sensor_that_the_table_does_not_have_cannot_be_stuck():
    assert parse_fault("stuck=floor_2", floors=2).value == 5.0
    with pytest.raises(InputError, match=r"'floor_3' is no sensor; one of .*, floor_1 to floor_2 is required"):
        parse_fault("stuck=floor_3", floors=2)


def test_frozen_controller_answers_but_applies_nothing():
    bench = Bench(faults=["frozen@20"]).armed()
    answers = bench.run(sine(40))
    assert [answer.step for answer in answers] == [*range(20), *[19] * 20]
    assert len({answer.acceleration for answer in answers[20:]}) == 1
    bench.faults.clear("frozen")
    assert bench.run(sine(5), first=40)[-1].step == 44


def test_dead_controller_does_not_answer():
    bench = Bench(faults=["dead@20"]).armed()
    assert [answer.step for answer in bench.run(sine(40))] == list(range(20))


def test_stuck_sensor_keeps_its_value():
    bench = Bench(faults=["stuck=floor_1@20"]).armed()
    answers = bench.run(sine(40))
    assert len({answer.floor_accelerations[0] for answer in answers[:20]}) == 20
    assert len({answer.floor_accelerations[0] for answer in answers[20:]}) == 1
    assert len({answer.floor_accelerations[1] for answer in answers}) == 40


@pytest.mark.parametrize("fault", ["valve=1@20", "pressure=0@20"])
def test_hydraulic_fault_ends_in_the_tracking_interlock(fault):
    bench = Bench(Config().changed(virtual_controller__tracking_limit=0.01), [fault]).armed()
    bench.run(sine(120))
    assert bench.controller.interlock & Interlock.TRACKING


def test_network_without_faults_changes_nothing():
    assert FaultyNetwork(Faults(), 0).transmit(b"abc", 7) == [(7, b"abc")]


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("loss=30", lambda arrivals: sum(len(a) == 0 for a in arrivals) / len(arrivals)),
        ("duplicates=30", lambda arrivals: sum(len(a) == 2 for a in arrivals) / len(arrivals)),
        ("bit_flips=30", lambda arrivals: sum(a[0][1] != b"abc" for a in arrivals) / len(arrivals)),
        ("reordering=30", lambda arrivals: sum(a[0][0] > 5 * MS for a in arrivals) / len(arrivals)),
    ],
)
def test_shares_of_network_faults_are_as_asked_for_and_come_from_the_seed(fault, expected):
    def send(seed):
        network = FaultyNetwork(Faults([parse_fault(fault)]), seed)
        return [network.transmit(b"abc", 0) for _ in range(2000)]

    # 2000 trials of 30 % have a standard deviation of 1 %.
    assert expected(send(1)) == pytest.approx(0.3, abs=0.05)
    assert send(1) == send(1)
    assert send(1) != send(2)


def test_delay_and_jitter_are_in_milliseconds():
    network = FaultyNetwork(Faults([parse_fault("delay=5"), parse_fault("jitter=2")]), 0)
    dues = [network.transmit(b"abc", 0)[0][0] for _ in range(500)]
    assert min(dues) >= 5 * MS
    assert max(dues) <= 7 * MS
    assert max(dues) - min(dues) > 1.5 * MS


# ---- return to rest


@pytest.mark.parametrize(("displacement", "velocity"), [(0.1, 0.0), (0.05, 0.3), (-0.02, 0.2), (0.0, -0.5)])
def test_return_to_rest_is_that_of_a_critically_damped_oscillator(displacement, velocity):
    omega, dt = 6.0, 5e-4
    x, v = displacement, velocity
    for k in range(1, 5001):
        a = return_acceleration(x, v, omega, dt)
        x, v = x + dt * v + 0.5 * dt**2 * a, v + dt * a
        t = k * dt
        expected = (displacement + (velocity + omega * displacement) * t) * math.exp(-omega * t)
        assert x == pytest.approx(expected, abs=2e-4)
    assert at_rest(x, v)
