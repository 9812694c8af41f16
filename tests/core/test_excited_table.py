"""Driving a table: limits, stopping whatever happens, and records with gaps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.identification.excitation import ExcitationSettings, excitation_command
from bmd_rths_core.identification.excited_table import DrivingStopped, drive, responses_of
from bmd_rths_core.loop.build import make_supervisor, make_table_controller
from bmd_rths_core.loop.hosting import VirtualClock
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.safety.commanded_motion import REST
from bmd_rths_core.table.controller import TableMeasurement
from tests.core.simulated_responses import simulated_responses

DT = 0.005
CONFIG = Config()
CONFIGS = Path(__file__).parents[2] / "config"


class Table:
    """A table that writes down its calls and applies half of each command."""

    def __init__(self, floors=(1.0, 2.0), fails_at=None):
        self.calls, self.commands = [], []
        self._floors, self._fails_at = np.array(floors), fails_at

    def connect(self):
        self.calls.append("connect")

    def exchange(self, command):
        self.calls.append(command.step)
        self.commands.append(command.acceleration)
        if command.step == self._fails_at:
            raise OSError("no answer")
        a = 0.5 * command.acceleration
        return TableMeasurement(command.step, a, 0.0, 3.0 * a, 0.0, 0.0, self._floors * a)

    def stop(self):
        self.calls.append("stop")

    emergency_stop = stop

    def close(self):
        self.calls.append("close")


def test_record_has_what_was_applied_and_measured():
    table, done = Table(), []
    commands = np.arange(1.0, 6.0)
    responses = drive(table, make_supervisor(CONFIG), commands, DT, progress=done.append)
    assert table.calls[:6] == ["connect", 0, 1, 2, 3, 4]
    assert table.calls[-1] == "close"
    assert responses.command.tolist() == (0.5 * commands).tolist()
    assert responses.table.tolist() == (1.5 * commands).tolist()
    assert responses.floors.tolist() == np.outer(0.5 * commands, [1.0, 2.0]).tolist()
    assert (responses.largest_table, responses.largest_floor) == (7.5, 5.0)
    assert done == [5]


def test_table_is_brought_to_rest_where_it_was():
    table = make_table_controller(CONFIG.changed(simulated_table__dynamics="perfect"))
    applied = []
    exchange = table.exchange
    table.exchange = lambda command: applied.append(command.acceleration) or exchange(command)
    drive(table, make_supervisor(CONFIG), np.arange(1.0, 6.0), DT)
    after = len(applied) - np.arange(len(applied)) - 0.5
    assert np.sum(applied) * DT == pytest.approx(0.0, abs=1e-11)
    assert after @ np.array(applied) * DT**2 == pytest.approx(0.0, abs=1e-10)


def test_command_over_the_limit_does_not_reach_the_table_which_is_stopped():
    table = Table()
    with pytest.raises(DrivingStopped, match="step 2"):
        drive(table, make_supervisor(CONFIG), np.array([1.0, 2.0, 99.0, 1.0]), DT)
    assert table.commands[:2] == [1.0, 2.0]
    assert max(np.abs(table.commands)) <= CONFIG.safety.ramp_acceleration
    assert table.commands[-1] == 0.0
    assert table.calls[-2:] == ["stop", "close"]


def test_table_that_fails_is_stopped_and_closed():
    table = Table(fails_at=1)
    with pytest.raises(DrivingStopped, match="table controller at step 1: no answer"):
        drive(table, make_supervisor(CONFIG), np.ones(4), DT)
    assert table.calls[:3] == ["connect", 0, 1]
    assert set(table.calls[3:]) == {"stop", "close"}


def test_sensor_without_values_is_refused_in_one_line():
    with pytest.raises(InputError, match="step 0 has no acceleration") as error:
        drive(Table(floors=(1.0, np.nan)), make_supervisor(CONFIG), np.ones(3), DT)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["simplified_bmd", "eight_story_bmd"])
def test_a_driven_table_answers_as_its_matrices_do(name):
    """So that tests of what is made of the answers need not drive."""
    config = load_config(CONFIGS / f"{name}.yaml").changed(run__seed=3, simulated_table__command_delay=0.0062)
    command = excitation_command(ExcitationSettings(duration=20.0), DT)
    ours, driven = simulated_responses(config, command), drive(*of(config), command, DT)
    for signal in ("command", "table", "floors", "displacement", "shear"):
        expected = getattr(driven, signal)
        assert np.abs(getattr(ours, signal) - expected).max() <= 1e-9 * np.abs(expected).max(), signal


def of(config):
    return make_table_controller(config), make_supervisor(config)


def test_simulated_table_can_be_driven():
    responses = drive(make_table_controller(CONFIG), make_supervisor(CONFIG), np.ones(50), DT)
    assert responses.floors.shape == (50, 2)
    assert responses.table[-1] == pytest.approx(1.0, abs=0.5)


@pytest.fixture(scope="module")
def record():
    config = CONFIG.changed(ground_motion__duration=2.0)
    return RthsLoop(config, select_ground_motion(config.ground_motion, DT)).run()


def test_longest_stretch_without_a_gap_is_taken(record):
    table, floors = record.table_acceleration.copy(), record.floor_accelerations.copy()
    table[50], floors[300, 1] = np.nan, np.nan
    responses = responses_of(replace(record, table_acceleration=table, floor_accelerations=floors, source="some_bag"))
    assert responses.command.tolist() == record.applied_command[51:300].tolist()
    assert responses.floors.tolist() == record.floor_accelerations[51:300].tolist()
    assert responses.source == f"steps 51 to 299 of {record.steps} of some_bag"


def test_whole_record_without_gaps(record):
    assert len(responses_of(record).command) == record.steps


def test_record_without_a_sensor_is_refused(record):
    with pytest.raises(InputError, match="no step has"):
        responses_of(replace(record, table_acceleration=np.full(record.steps, np.nan)))


class LateClock(VirtualClock):
    """A clock of a computer that stands still for 0.1 s in every second."""

    def __init__(self):
        super().__init__()
        self._next = 0.125

    def wait(self, until):
        if until > self._next:
            until, self._next = self._next + 0.1, self._next + 1.0
        super().wait(until)


class HoldingTable(Table):
    """An ideal table that holds each command until the next one."""

    def __init__(self, clock):
        super().__init__()
        self.motions, self._clock, self._held_since = [REST], clock, 0.0

    def exchange(self, command):
        now, motion = self._clock.now(), self.motions[-1]
        moved = motion.after(motion.acceleration, now - self._held_since)
        self.motions.append(moved._replace(acceleration=command.acceleration))
        self._held_since = now
        a = command.acceleration
        return TableMeasurement(command.step, a, moved.displacement, a, 0.0, 0.0, self._floors * a)


class StallingClock(VirtualClock):
    """A clock of a computer that is held up for most of a step between every 37th tick and its command."""

    waits = 0

    def wait(self, until):
        super().wait(until)
        self.waits += 1

    def now(self):
        now = super().now()
        if self.waits % 37 == 36:
            self.wait(now + 0.97 * DT)
        return now


def test_command_that_was_held_up_is_held_for_half_a_step_at_least():
    table = HoldingTable(clock := StallingClock())
    times, exchange = [], table.exchange
    table.exchange = lambda command: (times.append(clock._now), exchange(command))[1]
    commands = 0.1 * np.sin(np.arange(400))
    drive(table, make_supervisor(CONFIG), commands, DT, clock=clock)
    between = np.diff(times[: len(commands)])
    assert np.count_nonzero(between > 1.4 * DT) > 10
    assert between.min() > 0.45 * DT


def test_lost_time_does_not_add_up_to_a_drift():
    settings = ExcitationSettings("noise", band=(6.3, 126.0), amplitude=2.0, duration=20.0, stroke=0.1, seed=0)
    commands = excitation_command(settings, DT)
    clock = LateClock()
    table = HoldingTable(clock)
    driven = drive(table, make_supervisor(CONFIG), commands, DT, clock=clock)
    displacements = np.array([motion.displacement for motion in table.motions])
    assert np.abs(displacements).max() < 0.1
    assert displacements[-1] == pytest.approx(0.0, abs=1e-3)
    assert np.abs(driven.command - commands[: len(driven.command)]).max() < 0.5 * np.abs(commands).max()


def test_commands_in_time_are_those_that_were_planned():
    settings = ExcitationSettings("noise", band=(6.3, 126.0), amplitude=2.0, duration=20.0, stroke=0.1, seed=0)
    commands = excitation_command(settings, DT)
    table = HoldingTable(clock := VirtualClock())
    drive(table, make_supervisor(CONFIG), commands, DT, clock=clock)
    sent = np.array([motion.acceleration for motion in table.motions[1 : len(commands) + 1]])
    assert sent == pytest.approx(commands, abs=1e-3)
