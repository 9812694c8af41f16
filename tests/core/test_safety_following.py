"""An emergency stop is for a table that does not follow its commands, not for one that merely lags."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.safety import Action, SafetyConfig, SafetySupervisor, State
from bmd_rths_core.safety.commanded_motion import REST, Motion
from bmd_rths_core.safety.following import FollowingCheck
from bmd_rths_core.safety.ramp import ramp_commands
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.simulated import SimulatedTable

CONFIG = Config().changed(safety__increment_action="ignore")
LIMIT = CONFIG.safety.displacement_limit
DT = 0.005


def servo_table(config=CONFIG):
    """Return the servo table of the paper's delay, with control-structure interaction, without noise."""
    quiet = config.changed(simulated_table__acceleration_noise=0.0)
    return SimulatedTable(quiet.simulated_table, quiet.specimen.building(), config.run.time_step, 0)


def drive_to_limit(acceleration, sensed, config=CONFIG):
    """Accelerate a servo table until the supervisor refuses, then bring it to rest; return what was measured."""
    table, supervisor = servo_table(config), SafetySupervisor(config.safety, config.run.time_step)
    measured, commands = [], iter(range(100_000))
    for step in commands:
        if not supervisor.check(step, acceleration):
            break
        measured.append(sensed(step, table.exchange(TableCommand(step, acceleration))))
        supervisor.observe(measured[-1])
    while not supervisor.at_rest and (command := supervisor.advance()) is not None:
        measured.append(sensed(command.step, table.exchange(command)))
        supervisor.observe(measured[-1])
    return supervisor, np.array([m.table_displacement for m in measured])


def as_it_is(step, measurement):
    return measurement


@pytest.mark.parametrize("time_step", [0.005, 0.002, 0.001])
@pytest.mark.parametrize("acceleration", [0.5, 1.0, 2.0, 5.0, -2.0, -5.0])
def test_ramp_of_a_table_that_lags_is_not_turned_into_an_emergency_stop(acceleration, time_step):
    supervisor, displacement = drive_to_limit(acceleration, as_it_is, CONFIG.changed(run__time_step=time_step))
    assert supervisor.trips[0].quantity == "predicted displacement until rest"
    assert np.abs(displacement).max() < LIMIT + 0.02  # the room that the limit leaves for the lag
    assert not supervisor.emergency
    assert {trip.action for trip in supervisor.trips} == {Action.RAMP}
    assert supervisor.state is State.STOPPED
    assert abs(displacement[-1]) < 1e-3


def test_some_of_these_tables_do_pass_the_limit():
    """Otherwise the test above would show nothing."""
    passed = [np.abs(drive_to_limit(a, as_it_is)[1]).max() > LIMIT for a in (0.5, 1.0, 2.0, 5.0, -2.0, -5.0)]
    assert any(passed)


def runs_on(since):
    """Return a sensor of a table that goes on with its velocity instead of braking."""
    state = {}

    def sensed(step, measurement):
        if step < since:
            state["last"], state["velocity"] = (
                measurement.table_displacement,
                (measurement.table_displacement - state.get("last", 0.0)) / DT,
            )
            return measurement
        state["last"] += DT * state["velocity"]
        return measurement._replace(table_displacement=state["last"])

    return sensed


@pytest.mark.parametrize("acceleration", [0.5, 2.0, 5.0, -2.0])
def test_table_that_runs_on_is_stopped_at_once(acceleration):
    plain, _ = drive_to_limit(acceleration, as_it_is)
    supervisor, displacement = drive_to_limit(acceleration, runs_on(plain.trips[0].step))
    assert supervisor.emergency
    assert supervisor.trips[-1].quantity == "displacement, elsewhere than commanded,"
    assert supervisor.trips[-1].action is Action.EMERGENCY_STOP
    one_step = np.abs(np.diff(displacement)).max()
    assert np.abs(displacement).max() < LIMIT + 0.02 + CONFIG.safety.following_tolerance + one_step


def test_table_that_moves_more_than_it_is_asked_for_is_stopped_at_once():
    def sensed(step, measurement):
        return measurement._replace(table_displacement=1.2 * measurement.table_displacement)

    supervisor, displacement = drive_to_limit(2.0, sensed)
    assert supervisor.emergency
    assert np.abs(displacement).max() < LIMIT + 0.01


def test_table_that_drifts_away_at_rest_is_stopped_at_once():
    """However slowly: the mean offset, which the prediction takes into account, explains nothing here."""

    def sensed(step, measurement):
        return measurement._replace(table_displacement=0.01 * step * DT)

    supervisor, displacement = drive_to_limit(0.0, sensed)
    assert supervisor.emergency
    assert np.abs(displacement).max() < LIMIT + 1e-3


MOTIONS = st.floats(-0.3, 0.3)


@given(st.lists(MOTIONS, min_size=20, max_size=20), st.integers(0, 10), st.floats(-0.004, 0.004))
def test_any_lag_up_to_the_time_is_explained(path, lag, error):
    check = FollowingCheck(SafetyConfig(), DT)
    for displacement in path[:-1]:
        check.note(Motion(displacement, 0.0, 0.0))
    assert check.explains(path[-1], path[-1 - lag] + math.copysign(error, path[-1 - lag]))


@given(st.lists(MOTIONS, min_size=20, max_size=20), st.floats(0.0051, 1.0))
def test_nothing_farther_out_than_all_of_them_is_explained(path, beyond):
    check = FollowingCheck(SafetyConfig(), DT)
    for displacement in path[:-1]:
        check.note(Motion(displacement, 0.0, 0.0))
    recent = path[-11:]
    outer = max(*recent, 0.0)
    assert not check.explains(path[-1], outer + beyond)
    assert not check.explains(path[-1], min(*recent, 0.0) - beyond)


@pytest.mark.parametrize("steps", [1, 4, 30, 100_000])
def test_held_command_is_remembered_step_by_step(steps):
    motion, check, one_by_one = Motion(0.1, -0.2, 0.5), FollowingCheck(SafetyConfig(), DT), []
    check.note(motion, steps)
    for k in range(max(0, steps - 10), steps):
        one_by_one.append(0.1 - 0.2 * k * DT + 0.25 * (k * DT) ** 2)
    assert list(check._past)[-len(one_by_one) :] == pytest.approx(one_by_one, rel=1e-12)
    check.reset()
    assert not check.explains(REST.displacement, 0.0051)


# ---- the way to rest keeps the limits


def test_way_to_rest_that_would_pass_the_velocity_limit_is_refused():
    with pytest.raises(InputError) as error:
        SafetyConfig(velocity_limit=0.1, ramp_velocity=0.15)
    problem = "safety.ramp_velocity: 0.15 m/s on the way to rest passes safety.velocity_limit; <= 0.1 m/s is required"
    assert str(error.value) == problem
    SafetyConfig(velocity_limit=0.15, ramp_velocity=0.15)
    SafetyConfig(velocity_limit=0.1, ramp_velocity=0.15, velocity_action="ignore")


def test_way_to_rest_keeps_the_acceleration_limit():
    config = SafetyConfig(acceleration_limit=0.5, ramp_acceleration=5.0)
    commands = ramp_commands(Motion(0.1, 0.2, 0.4), config, DT)
    assert 0.45 < np.abs(commands).max() <= 0.5
    assert SafetyConfig(acceleration_limit=0.5, acceleration_action="ignore").braking_acceleration == 5.0
