"""UDP table controller: every fault of network and controller is counted, named, and never half-used."""

import time

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.controller import NoAnswer, TableCommand
from bmd_rths_core.table.wire import ControllerState, Interlock, Kind
from bmd_rths_nodes.hardware.controllers import make_table_controller as make_udp_table
from tests.nodes.emulation import LOCKSTEP, emulator
from tests.nodes.scripted_controller import REAL_TIME, answer_to, counts

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
        for step in range(10):
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
