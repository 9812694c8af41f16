"""What follows the last step of a test is recorded until the table is at rest, beside the signals of the test."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bmd_rths_core.analysis.table_peaks import table_peaks, table_peaks_to_rest
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.record import RunRecord
from bmd_rths_core.rest_record import REST_SIGNALS, rest_record
from bmd_rths_core.safety import Action
from bmd_rths_core.table.controller import TableMeasurement
from tests.core.driven_table import DT, Asynchronous, Host, Waiting

#: A test that is too short to come to rest by itself, on a table without noise.
SHORT = Config().changed(
    ground_motion__duration=3.0,
    ground_motion__free_vibration=0.0,
    simulated_table__displacement_noise=0.0,
)


def run(**changes) -> RunRecord:
    config = SHORT.changed(**changes)
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


class Watched(Host):
    """A host that keeps what the driver tells of the way to rest."""

    def __init__(self, world, **options):
        super().__init__(world, **options)
        self.commands, self.answers = [], []
        hooks = (self.measured.append, self.commands.append, self.answers.append)
        supervisor, lockstep = self.driver.supervisor, options.get("lockstep", False)
        self.driver = TableDriver(world, supervisor, DT, lockstep, *hooks)
        self.driver.arm()


def motion_after(commands, time_step):
    """Return displacement and velocity after commands that were held for a time step each, from rest."""
    velocity = np.append(0.0, np.cumsum(commands)) * time_step
    displacement = np.sum(velocity[:-1] * time_step + 0.5 * commands * time_step**2)
    return displacement, velocity[-1]


def test_commands_of_test_and_way_to_rest_lead_the_table_back_to_where_it_began():
    record = run()
    rest = record.way_to_rest
    assert (record.outcome, rest.first_step) == ("finished", record.steps)
    displacement, velocity = motion_after(record.continued("command"), record.time_step)
    assert abs(velocity) < 2e-5
    assert abs(displacement) < 2e-5
    moving, _ = motion_after(record.command, record.time_step)
    assert abs(moving) > 1e-3


def test_way_to_rest_is_measured_too_and_what_was_measured_goes_on_smoothly():
    record = run()
    rest = record.way_to_rest
    assert all(np.isfinite(values).all() for name, values in rest.signals().items() if name != "base_shear")
    displacement = record.continued("table_displacement")
    largest = 1.2 * np.abs(record.continued("table_acceleration")).max() * record.time_step**2
    assert np.abs(np.diff(displacement, 2)).max() < largest
    assert abs(displacement[-1]) < 1e-3  # the real table follows its commands late


def test_peaks_reach_to_the_end_of_the_way_to_rest():
    """A table that drifts is farthest out after the test."""
    record = run(safety__acceleration_limit=1.0, safety__ramp_acceleration=1.0)
    beyond = np.abs(record.way_to_rest.table_displacement).max()
    in_the_test = np.nanmax(np.abs(record.table_displacement))
    assert beyond > 1.2 * in_the_test
    assert table_peaks_to_rest(record).displacement == beyond
    assert table_peaks(record).displacement == in_the_test
    assert table_peaks_to_rest(replace(record, way_to_rest=None)) == table_peaks(record)


def test_refused_command_is_followed_in_its_own_slot():
    record = run(safety__acceleration_limit=1.0, safety__ramp_acceleration=1.0)
    rest, last = record.way_to_rest, record.steps - 1
    assert (record.outcome, rest.first_step) == ("limit", last)
    assert abs(record.command[last]) > 1.0
    assert np.isnan(record.applied_command[last])
    assert np.abs(rest.command).max() <= 1.0
    whole = record.continued("command")
    assert whole[last] == rest.command[0]
    assert np.array_equal(whole[:last], record.command[:last])
    assert len(whole) == last + rest.steps


def test_hold_ends_where_the_table_stands():
    record = run(safety__acceleration_limit=1.0, safety__ramp_acceleration=1.0, safety__acceleration_action="hold")
    _, velocity = motion_after(record.continued("command"), record.time_step)
    assert abs(velocity) < 2e-5
    assert record.way_to_rest.command[-10:].any()


def test_emergency_stop_leaves_no_way_to_rest():
    record = run(safety__acceleration_limit=1.0, safety__acceleration_action="emergency_stop")
    assert (record.outcome, record.way_to_rest) == ("limit", None)


@pytest.mark.parametrize("world", [Waiting, Asynchronous])
def test_real_time_tells_every_command_and_every_answer(world):
    lost = {44, 45}
    host = Watched(world(answers=lambda step: None if step in lost else 0.001))
    host.follow(np.full(40, 0.5))
    host.driver.finish(Action.RAMP, host.world.now)
    host.wait(host.world.now + 5.0)
    assert host.state is DriveState.AT_REST
    sent = [(step, acceleration) for _, step, acceleration in host.world.begun if step >= 40]
    assert [tuple(command) for command in host.commands] == sent
    assert [measured.step for measured in host.answers] == [step for step, _ in sent if step not in lost]
    assert [measured.step for measured in host.measured] == list(range(40))


def test_table_that_is_held_tells_nothing_until_it_is_brought_back():
    host = Watched(Waiting())
    host.follow(np.full(40, 0.5))
    host.driver.stop(Action.HOLD, Outcome.STOPPED, "stopped", host.world.now)
    host.wait(host.world.now + 1.0)
    assert host.state is DriveState.HELD
    told = len(host.commands)
    host.wait(host.world.now + 1.0)
    assert len(host.commands) == len(host.answers) == told
    host.driver.finish(Action.RAMP, host.world.now)
    host.wait(host.world.now + 5.0)
    assert host.state is DriveState.AT_REST
    assert len(host.commands) > told + 100
    assert host.commands[told].step > host.commands[told - 1].step + 100  # steps went on meanwhile


def test_rows_are_steps_and_what_is_missing_is_not_a_number():
    measured = TableMeasurement(7, 1.0, 2.0, 3.0, 4.0, math.nan, np.array([5.0, 6.0]))
    rest = rest_record({5: 0.5, 8: 0.25}, {7: measured}, 2)
    assert (rest.first_step, rest.steps) == (5, 4)
    assert np.array_equal(rest.command, [0.5, math.nan, math.nan, 0.25], equal_nan=True)
    assert np.array_equal(rest.table_displacement, [math.nan, math.nan, 2.0, math.nan], equal_nan=True)
    assert np.array_equal(rest.floor_accelerations[2], [5.0, 6.0])
    assert list(rest.signals()) == list(REST_SIGNALS)
    assert rest_record({}, {}, 2) is None


def test_two_ways_to_rest_are_the_same_bit_for_bit_or_not_at_all():
    rest = rest_record({5: 0.5, 8: 0.25}, {}, 2)
    assert rest.same_signals(rest_record({5: 0.5, 8: 0.25}, {}, 2))
    for other in (None, rest_record({6: 0.5, 9: 0.25}, {}, 2), rest_record({5: 0.5, 8: 0.25000001}, {}, 2)):
        assert not rest.same_signals(other)


def test_other_signals_end_with_the_test():
    with pytest.raises(ValueError, match="'corrected_force' is no signal of the way to rest"):
        run().continued("corrected_force")
