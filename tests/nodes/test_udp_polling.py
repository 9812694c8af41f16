"""UDP table controller without waiting: answers that are looked for now and then find their step, or are given up."""

import time

import pytest

from bmd_rths_core.table import udp_controller as udp
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.wire import ControllerState, Interlock, Kind
from tests.nodes.conftest import wait_until
from tests.nodes.scripted_controller import REAL_TIME, answer_to, counts


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


class HeldUp:
    """A socket of a process that gets no turn for 30 ms when it has sent."""

    def __init__(self, own):
        self._own = own

    def __getattr__(self, name):
        return getattr(self._own, name)

    def sendto(self, data, address):
        self._own.sendto(data, address)
        time.sleep(0.03)


def test_command_has_gone_when_the_process_is_held_up_after_it(scripted):
    """From this time the driver counts how long a command was held."""
    table, _ = scripted(lambda packet: [answer_to(packet)])
    own = table._transport._socket
    table._transport._socket = HeldUp(own)
    before = time.perf_counter()
    sent_at = table.begin(TableCommand(0, 0.0))
    after = time.perf_counter()
    table._transport._socket = own
    assert before <= sent_at < after - 0.03


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
