"""UDP table controller: every fault of network and controller is counted, named, and never half-used."""

import json
import math
import socket
import struct
import threading
import time
import zlib
from collections import Counter

import numpy as np
import pytest
from scipy import signal

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.identification.excited_table import DrivingStopped, drive
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.loop.table_driver import NOT_CONFIRMED
from bmd_rths_core.table import udp_controller as udp
from bmd_rths_core.table.controller import NoAnswer, TableCommand
from bmd_rths_core.table.emulated.faults import parse_fault
from bmd_rths_core.table.wire import (
    ControllerPacket,
    ControllerState,
    Interlock,
    Kind,
    decode_host_packet,
    encode_controller_packet,
)
from bmd_rths_nodes.hardware.controllers import make_table_controller as make_udp_table
from tests.nodes.conftest import CONFIG, processes_of_domain, wait_until
from tests.nodes.emulation import LOCKSTEP, emulator

#: No thread of a busy machine is this late; a lost answer or a silent host is what the test says it is.
PATIENT = {"table__answer_timeout": 0.09, "run__time_step": 0.1, "virtual_controller__watchdog": 5.0}
REAL_TIME = LOCKSTEP.changed(run__lockstep=False, **PATIENT)


def counts(table):
    return {name.removeprefix("udp_"): int(n) for name, n in table.statistics().items() if n.isdigit()}


def answer_to(packet, state=ControllerState.RUNNING, **changes):
    """Return an ordinary answer to a packet, with some fields changed."""
    fields = {"sequence": packet.sequence, "step": packet.step, "session": packet.session, "acceleration": 0.5}
    fields |= changes
    bits = fields.pop("interlock", Interlock(0))
    floors = fields.pop("floors", (1.0, 2.0))
    return encode_controller_packet(
        ControllerPacket(
            state=state,
            interlock=bits,
            clock=0,
            displacement=0.0,
            actuator_force=0.0,
            base_shear=math.nan,
            floor_accelerations=floors,
            **fields,
        )
    )


class Script:
    """A controller that arms like any other one, and answers commands as a test says."""

    def __init__(self, on_command):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)
        self.other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.datagrams = []
        self.state = self.after_stop = ControllerState.IDLE
        self.received = Counter()
        self._on_command = on_command
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self):
        while not self._ended.is_set():
            try:
                data, self.host = self.socket.recvfrom(100)
            except TimeoutError:
                continue
            packet = decode_host_packet(data)
            self.datagrams.append(data)
            self.received[packet.kind] += 1
            if packet.kind is Kind.COMMAND:
                for answer in self._on_command(packet):
                    self.socket.sendto(answer, self.host)
            else:
                if packet.kind is not Kind.STATUS:
                    self.state = ControllerState.ARMED if packet.kind is Kind.ARM else self.after_stop
                bits = Interlock.EMERGENCY_STOP if self.state is ControllerState.INTERLOCK else Interlock(0)
                self.socket.sendto(answer_to(packet, self.state, interlock=bits), self.host)

    def close(self):
        self._ended.set()
        self._thread.join()
        self.socket.close()
        self.other.close()


@pytest.fixture
def scripted():
    """Make a connected table whose commands are answered by a function."""
    made = []

    def make(on_command, config=REAL_TIME):
        script = Script(on_command)
        table = make_udp_table(config.changed(table__address=f"udp://127.0.0.1:{script.socket.getsockname()[1]}"))
        made.extend((table, script))
        table.connect()
        return table, script

    yield make
    for one in made:
        one.close()


# ---- lockstep


FAULTS = ("loss=15", "duplicates=15", "bit_flips=10", "jitter=1", "reordering=2")


@pytest.mark.parametrize("faults", [(), FAULTS], ids=["no faults", "bad network"])
def test_lockstep_over_udp_equals_the_loop_in_process_bit_for_bit(faults):
    config = LOCKSTEP.changed(ground_motion__duration=1.0, table__resend_after=0.005)
    motion = select_ground_motion(config.ground_motion, config.run.time_step)
    with emulator(config, faults) as (server, connected):
        table = make_udp_table(connected)
        record = RthsLoop(connected, motion, table).run()
        told = counts(table)
        assert (told["crc"] + told["magic"] + told["version"] > 0) == bool(faults)
        assert server.statistics()["state"] == "idle"
    assert record.same_signals(RthsLoop(Config().changed(ground_motion__duration=1.0), motion).run())


def test_controller_that_never_answers_ends_the_test_in_lockstep():
    config = LOCKSTEP.changed(table__give_up_after=0.2)
    with emulator(config, ["dead@3"]) as (_, connected):
        table = make_udp_table(connected)
        table.connect()
        for step in range(3):
            table.exchange(TableCommand(step, 0.0))
        with pytest.raises(RuntimeError, match=r"no answer from udp://127\.0\.0\.1:\d+ within 0\.2 s"):
            table.exchange(TableCommand(3, 0.0))
        table.stop()
        assert table.statistics()["udp_stop"] == "not confirmed"
        table.close()


# ---- real time


def test_real_time_answers_come_after_the_hold_and_the_table_follows():
    with emulator(REAL_TIME) as (_, connected):
        table = make_udp_table(connected)
        table.connect()
        for step in range(20):
            begin = time.perf_counter()
            measurement = table.exchange(TableCommand(step, 1.0))
            # The clock of the emulator stands still while it gets no turn, so it is never early.
            assert time.perf_counter() - begin > 0.9 * connected.virtual_controller.answer_after
            assert (measurement.step, measurement.applied_command) == (step, 1.0)
        table.stop()
        assert table.statistics()["udp_stop"] == "confirmed"
        assert counts(table)["lost"] == 0
        table.close()


def test_lost_answer_is_a_step_without_measurement_and_the_next_one_has_it_again(scripted):
    table, script = scripted(
        lambda p: [] if p.step == 1 else [answer_to(p)], REAL_TIME.changed(table__answer_timeout=0.05)
    )
    table.exchange(TableCommand(0, 0.0))
    with pytest.raises(NoAnswer, match="no answer to step 1 within 50 ms"):
        table.exchange(TableCommand(1, 0.0))
    assert table.exchange(TableCommand(2, 0.7)).step == 2
    assert script.received[Kind.COMMAND] == 3  # a command in real time is sent once
    assert counts(table)["lost"] == 1
    assert counts(table)["resent"] <= 1  # one more where this machine was late


def test_late_answer_is_counted_and_not_taken_for_that_of_the_next_step(scripted):
    late = []

    def on_command(packet):
        late.append(answer_to(packet, acceleration=-9.0) if packet.step == 0 else answer_to(packet))
        return late if packet.step else []

    table, _ = scripted(on_command, REAL_TIME.changed(table__answer_timeout=0.05))
    with pytest.raises(NoAnswer):
        table.exchange(TableCommand(0, 0.0))
    measurement = table.exchange(TableCommand(1, 0.0))
    assert (measurement.step, measurement.table_acceleration) == (1, 0.5)
    assert (counts(table)["lost"], counts(table)["late"], counts(table)["duplicate"]) == (1, 1, 0)


def test_doubled_answer_is_counted_and_dropped(scripted):
    table, _ = scripted(lambda p: [answer_to(p)] * 2)
    for step in range(5):
        assert table.exchange(TableCommand(step, 0.0)).step == step
    assert counts(table)["duplicate"] == 4  # the last one has not been looked at yet
    assert counts(table)["late"] == 0


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        (lambda p: b"", "length"),
        (lambda p: answer_to(p)[:-1], "length"),
        (lambda p: answer_to(p, floors=(1.0, 2.0, 3.0)), "length"),
        (lambda p: b"RTHX" + answer_to(p)[4:], "magic"),
        (lambda p: answer_to(p)[:4] + b"\2" + answer_to(p)[5:], "version"),
        (lambda p: answer_to(p)[:40] + b"\1" + answer_to(p)[41:], "crc"),
        (lambda p: answer_to(p, session=(p.session + 1) % 2**32), "wrong_session"),
    ],
)
def test_wrong_packet_before_the_right_one_is_counted_and_dropped(scripted, wrong, name):
    table, _ = scripted(lambda p: [wrong(p), answer_to(p)])
    assert table.exchange(TableCommand(0, 0.0)).table_acceleration == 0.5
    assert counts(table)[name] == 1


def test_packet_from_another_address_is_counted_and_dropped(scripted):
    def on_command(packet):
        script.other.sendto(answer_to(packet, acceleration=-9.0), script.host)
        return [answer_to(packet)]

    table, script = scripted(on_command)
    assert table.exchange(TableCommand(0, 0.0)).table_acceleration == 0.5
    assert counts(table)["wrong_address"] == 1


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            lambda p: answer_to(p, ControllerState.INTERLOCK, interlock=Interlock.WATCHDOG | Interlock.FORCE),
            r"is in an interlock \(force, watchdog\)",
        ),
        (lambda p: answer_to(p, ControllerState.IDLE), "is idle: it was stopped or restarted"),
        (lambda p: answer_to(p, ControllerState.STOPPING), "is stopping"),
        (lambda p: answer_to(p, step=7), "answers step 0, but the last command it applied is 7"),
    ],
)
def test_controller_that_does_not_run_ends_the_test_with_its_reason(scripted, answer, message):
    table, _ = scripted(lambda p: [answer(p)])
    with pytest.raises(RuntimeError, match=message):
        table.exchange(TableCommand(0, 0.0))


def test_frozen_controller_is_noticed_at_the_first_step():
    with emulator(LOCKSTEP, ["frozen@2"]) as (_, connected):
        table = make_udp_table(connected)
        table.connect()
        for step in range(2):
            table.exchange(TableCommand(step, 0.0))
        with pytest.raises(RuntimeError, match="answers step 2, but the last command it applied is 1"):
            table.exchange(TableCommand(2, 0.0))
        table.close()


# ---- without waiting


def polled(table, number):
    """Poll until so many measurements have come."""
    return [wait_until(table.poll) for _ in range(number)]


def test_commands_go_on_while_an_answer_is_missing_and_each_answer_finds_its_step(scripted):
    waiting = []

    def on_command(packet):
        waiting.append(packet)
        if packet.step < 2:
            return []
        return [answer_to(p, step=2, acceleration=float(p.step)) for p in waiting]  # the last one is applied by now

    table, _ = scripted(on_command)
    for step in range(3):
        table.begin(TableCommand(step, 0.1 * step))
    assert table.awaiting
    measurements = polled(table, 3)
    assert [(m.step, m.table_acceleration, m.applied_command) for m in measurements] == [
        (step, float(step), 0.1 * step) for step in range(3)
    ]
    assert not table.awaiting
    assert table.poll() is None
    assert (counts(table)["answered"], counts(table)["lost"]) == (5, 0)  # status, arm and three commands


def test_answer_that_does_not_come_in_time_is_given_up_and_not_used_when_it_comes(scripted):
    late = []

    def on_command(packet):
        late.append(answer_to(packet))
        return late if packet.step else []

    table, script = scripted(on_command, REAL_TIME.changed(table__answer_timeout=0.03))
    table.begin(TableCommand(0, 0.0))
    wait_until(lambda: table.poll() or not table.awaiting)
    assert counts(table)["lost"] == 1
    table.begin(TableCommand(1, 0.0))
    wait_until(lambda: script.received[Kind.COMMAND] == 2)
    wait_until(lambda: table.poll() is None and counts(table)["late"] == 1)


def test_answer_that_a_newer_one_has_overtaken_is_counted_and_dropped(scripted):
    waiting = []

    def on_command(packet):
        waiting.insert(0, answer_to(packet, step=1))
        return waiting if packet.step else []

    table, _ = scripted(on_command)
    for step in range(2):
        table.begin(TableCommand(step, 0.0))
    (measurement,) = polled(table, 1)
    assert measurement.step == 1
    wait_until(lambda: table.poll() is None and counts(table)["late"] == 1)
    assert counts(table)["lost"] == 1


def test_nothing_is_awaited_after_the_end(scripted):
    table, _ = scripted(lambda p: [])
    table.begin(TableCommand(0, 0.0))
    table.stop()
    assert not table.awaiting
    assert table.poll() is None
    assert (counts(table)["lost"], table.statistics()["udp_stop"]) == (1, "confirmed")
    with pytest.raises(RuntimeError, match="command of step 1 refused: the table is stopped"):
        table.begin(TableCommand(1, 0.0))


def test_controller_that_never_leaves_stopping_has_not_confirmed_the_stop(scripted):
    config = REAL_TIME.changed(table__stop_timeout=0.05, run__lockstep=True, table__resend_after=0.01)
    table, script = scripted(lambda p: [answer_to(p)], config)
    script.after_stop = ControllerState.STOPPING
    with pytest.raises(DrivingStopped, match=NOT_CONFIRMED):
        drive(table, make_supervisor(config), np.zeros(5), config.run.time_step)
    assert not table.stop_confirmed
    script.after_stop = script.state = ControllerState.IDLE
    assert drive(table, make_supervisor(config), np.zeros(5), config.run.time_step).source == "driven"
    assert table.stop_confirmed


@pytest.mark.slow
def test_run_whose_controller_never_leaves_stopping_has_failed(bmd_rths, tmp_path):
    script = Script(lambda packet: [answer_to(packet)])
    script.after_stop = ControllerState.STOPPING
    try:
        address = f"udp://127.0.0.1:{script.socket.getsockname()[1]}"
        changes = {"run.preflight": "skip", "ground_motion.duration": 0.2, "table.stop_timeout": 0.5}
        settings = [word for name, value in changes.items() for word in ("--set", f"{name}={value}")]
        options = ("--lockstep", "--composed", "--output", tmp_path / "bags", "--json")
        result = bmd_rths("run", CONFIG, "--table", address, *settings, *options).wait()
    finally:
        script.close()
    assert (result.status, "Traceback" in result.errors) == (1, False), result.errors
    told = json.loads(result.output)
    assert (told["outcome"], told["stability"], told["steps"]) == ("failed", "failed", 41)
    assert told["reason"].startswith("end of the ground motion")
    assert told["reason"].count(NOT_CONFIRMED) == 1
    analysed = bmd_rths("analyze", told["bag"]).wait()
    assert NOT_CONFIRMED in analysed.output


def test_poll_tells_why_the_controller_does_not_run(scripted):
    table, _ = scripted(lambda p: [answer_to(p, ControllerState.INTERLOCK, interlock=Interlock.FORCE)])
    table.begin(TableCommand(0, 0.0))
    with pytest.raises(RuntimeError, match=r"is in an interlock \(force\)"):
        polled(table, 1)


@pytest.mark.parametrize("lockstep", [False, True])
def test_waiting_host_keeps_its_session_until_the_first_command(scripted, monkeypatch, lockstep):
    monkeypatch.setattr(udp, "KEEP_ALIVE_PERIOD", 0.01)
    table, script = scripted(lambda p: [answer_to(p)], REAL_TIME.changed(run__lockstep=lockstep))
    wait_until(lambda: table.poll() or script.received[Kind.STATUS] > 5)
    assert table.exchange(TableCommand(0, 0.0)).step == 0
    asked = script.received[Kind.STATUS]
    for _ in range(5):
        assert table.poll() is None
        time.sleep(0.01)
    # From now on silence is for the watchdog of the controller to notice.
    assert script.received[Kind.STATUS] == asked
    assert counts(table)["duplicate"] == counts(table)["late"] == counts(table)["lost"] == 0


def test_interlock_while_waiting_is_told(scripted, monkeypatch):
    monkeypatch.setattr(udp, "KEEP_ALIVE_PERIOD", 0.01)
    table, script = scripted(lambda p: [answer_to(p)])
    script.state = ControllerState.INTERLOCK
    with pytest.raises(RuntimeError, match=r"is in an interlock \(emergency stop\)"):
        wait_until(table.poll)


# ---- displacement


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


# ---- session


def test_silent_host_finds_an_interlock_that_only_a_reset_ends():
    config = REAL_TIME.changed(virtual_controller__return_frequency=50.0, virtual_controller__watchdog=0.05)
    with emulator(config) as (server, connected):
        table = make_udp_table(connected)
        table.connect()
        table.exchange(TableCommand(0, 1.0))
        wait_until(lambda: server.statistics()["state"] == "interlock")
        with pytest.raises(RuntimeError, match=r"is in an interlock \(watchdog\)"):
            table.exchange(TableCommand(1, 1.0))
        with pytest.raises(RuntimeError, match=r"\(watchdog\); look at the table, then reset the interlock"):
            table.connect()
        table.close()
        wait_until(lambda: can_connect(make_udp_table(connected.changed(table__reset_interlock=True))))


def can_connect(table):
    try:
        table.connect()
    except RuntimeError:
        return False
    finally:
        table.close()
    return True


def test_controller_of_a_host_that_died_tells_the_next_one_what_to_do():
    config = REAL_TIME.changed(virtual_controller__return_frequency=50.0, virtual_controller__watchdog=0.05)
    with emulator(config) as (_, connected):
        dead = make_udp_table(connected)
        dead.connect()
        dead.exchange(TableCommand(0, 1.0))
        dead._transport.close()
        following = make_udp_table(connected.changed(table__give_up_after=4.0))
        with pytest.raises(RuntimeError, match=r"\(watchdog\); .* or start with table\.reset_interlock=true"):
            following.connect()
        following.close()
        wait_until(lambda: can_connect(make_udp_table(connected.changed(table__reset_interlock=True))))


def test_emergency_stop_is_an_interlock_at_once():
    with emulator(REAL_TIME) as (server, connected):
        table = make_udp_table(connected)
        table.connect()
        table.exchange(TableCommand(0, 1.0))
        table.emergency_stop()
        assert server.statistics()["state"] == "interlock"
        assert server.statistics()["interlock"] == Interlock.EMERGENCY_STOP
        assert table.statistics()["udp_stop"] == "confirmed"
        with pytest.raises(RuntimeError, match="refused: the table is stopped"):
            table.exchange(TableCommand(1, 1.0))
        table.close()


def test_second_host_cannot_disturb_the_first():
    with emulator() as (server, connected):
        first, second = make_udp_table(connected), make_udp_table(connected.changed(table__give_up_after=0.1))
        first.connect()
        first.exchange(TableCommand(0, 0.0))
        with pytest.raises(RuntimeError, match="no answer"):
            second.connect()
        assert first.exchange(TableCommand(1, 0.0)).step == 1
        assert server.statistics()["wrong_session"] > 0
        first.close()
        second.connect()  # the table is free now
        second.close()


def test_nobody_there_and_unknown_host_are_told_in_one_line():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        config = LOCKSTEP.changed(table__give_up_after=0.1)
        silent = make_udp_table(config.changed(table__address=f"udp://127.0.0.1:{nobody.getsockname()[1]}"))
        with pytest.raises(RuntimeError, match=r"no answer from udp://127\.0\.0\.1:\d+ within 0\.1 s"):
            silent.connect()
        silent.close()
    unusable = make_udp_table(LOCKSTEP.changed(table__local_address="udp://192.0.2.1:0"))
    with pytest.raises(OSError, match=r"udp://127\.0\.0\.1:50600 from udp://192\.0\.2\.1:0: Cannot assign"):
        unusable.connect()


def test_fault_at_run_time_through_the_controller_is_seen_by_the_host():
    with emulator() as (server, connected):
        table = make_udp_table(connected.changed(table__give_up_after=0.1))
        table.connect()
        table.exchange(TableCommand(0, 0.0))
        server._faults.set(parse_fault("loss=100"))
        with pytest.raises(RuntimeError, match="no answer"):
            table.exchange(TableCommand(1, 0.0))
        server._faults.clear("loss")
        table.close()
        assert table.statistics()["udp_stop"] == "confirmed"


@pytest.mark.parametrize("options", [(), ("--composed",)], ids=["five processes", "composed"])
def test_controller_that_is_idle_while_armed_ends_a_run_with_its_own_reason(bmd_rths, tmp_path, domain, options):
    """Before the test begins: another program stops the controller while the nodes look for each other."""
    script = Script(lambda packet: [])
    try:
        address = f"udp://127.0.0.1:{script.socket.getsockname()[1]}"
        settings = ("--set", "run.preflight=skip", "--set", "run.settling_time=8.0", *options)
        child = bmd_rths("run", CONFIG, "--table", address, *settings, "--output", tmp_path / "bags")
        wait_until(lambda: script.received[Kind.ARM])
        script.state = ControllerState.IDLE
        result = child.wait()
    finally:
        script.close()
    assert result.status == 1
    told = result.output + result.errors  # composed nodes find each other so soon that there may be a bag by then
    assert f"table_driver: table controller: {address} is idle: it was stopped or restarted" in told
    assert "did not find each other" not in told
    assert processes_of_domain(domain) == {}
