"""The supervisor: every limit at its step, with its text and action; latched; nothing moves after a stop."""

import math

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.safety import Action, SafetyConfig, SafetySupervisor, State, Trip
from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.table.models.simulated import SimulatedTable
from tests.core.test_loop import EL_CENTRO

DT = 0.005
STOPPING = [Action.HOLD, Action.RAMP, Action.EMERGENCY_STOP]
STATES = {Action.HOLD: State.HOLDING, Action.RAMP: State.RAMPING, Action.EMERGENCY_STOP: State.STOPPED}


def supervisor(**changes):
    return SafetySupervisor(SafetyConfig(**changes), DT)


def measurement(step, applied=0.0, displacement=0.0, acceleration=0.0, force=0.0, shear=0.0, floors=(0.0, 0.0)):
    return TableMeasurement(step, applied, displacement, acceleration, force, shear, np.array(floors))


def rest(observed, steps, first=0):
    """Run some steps at rest."""
    for step in range(first, first + steps):
        assert observed.check(step, 0.0)
        observed.observe(measurement(step))


def way_to_rest(observed):
    """Return every command on the way to rest, at most one after a hold has come to rest."""
    commands = []
    while not observed.at_rest and (command := observed.advance()) is not None:
        commands.append(command)
    return commands


# ---- each limit: a change of the configuration, what happens in step 5, the trip that is told


def send(*commands):
    return lambda observed: [observed.check(5 + i, command) for i, command in enumerate(commands)]


def sense(**values):
    def happen(observed):
        assert observed.check(5, 0.0)
        observed.observe(measurement(5, **values))

    return happen


def skip(steps):
    return lambda observed: observed.check(5 + steps, 0.0)


def be_silent(steps):
    return lambda observed: observed.goes_on_without(steps * DT)


def hear_nothing(steps):
    return lambda observed: [observed.check(5 + i, 0.0) for i in range(steps + 1)]


CASES = {
    "acceleration": (
        *({"acceleration_limit": 1.0, "ramp_acceleration": 1.0}, send(1.1), 5),
        *("m/s2", 1.1, "command 1.1, allowed is 1"),
    ),
    "negative acceleration": (
        *({"acceleration_limit": 1.0, "ramp_acceleration": 1.0}, send(-1.1), 5),
        *("m/s2", -1.1, "command -1.1, allowed is 1"),
    ),
    "increment": ({"increment_limit": 1.5}, send(1.0, -0.6), 6, "m/s2", -1.6, "change of the command -1.6"),
    "displacement": ({"displacement_limit": 0.1}, sense(displacement=-0.2), 5, "m", -0.2, "commanded, -0.2, allowed"),
    "force": ({"force_limit": 1e3}, sense(force=-2e3), 5, "N", -2e3, "actuator force -2000, allowed is 1000"),
    "tracking": ({"tracking_time": DT, "tracking_limit": 1.0}, sense(acceleration=2.0), 5, "m/s2", 2.0, "error 2,"),
    "stale_shear": ({"stale_shear_time": 0.015}, skip(4), 9, "s", 0.02, "a command 0.02, allowed is 0.015"),
    "silent shear": ({"stale_shear_time": 0.015}, be_silent(4), 9, "s", 0.02, "a command 0.02, allowed is 0.015"),
    "stale_controller": ({"stale_controller_time": 0.015}, hear_nothing(4), 9, "s", 0.02, "measurement 0.02, allowed"),
}


def parameter_of(limit):
    return f"{limit}_time" if limit.startswith("stale") else f"{limit}_limit"


@pytest.mark.parametrize("action", STOPPING)
@pytest.mark.parametrize("case", CASES)
def test_limit_trips_at_its_step_with_its_text_and_its_action(case, action):
    changes, happen, step, unit, value, words = CASES[case]
    limit = {"negative acceleration": "acceleration", "silent shear": "stale_shear"}.get(case, case)
    observed = supervisor(**changes, **{f"{limit}_action": action.name.lower()})
    rest(observed, 5)
    happen(observed)
    if case == "displacement":  # a table that does not follow the commands cannot be brought to rest by them
        action = Action.EMERGENCY_STOP
    (trip,) = observed.trips
    key = parameter_of(limit)
    assert trip.limit == f"safety.{key}"
    assert (trip.unit, trip.step, trip.action) == (unit, step, action)
    assert trip.value == pytest.approx(value)
    assert trip.allowed == getattr(SafetyConfig(**changes), key)
    assert f"safety.{key} [{unit}] passed at step {step}: " in str(trip)
    assert words in str(trip)
    assert str(trip).endswith({"hold": "hold", "ramp": "ramp to rest"}.get(action.name.lower(), "emergency stop"))
    assert observed.reason == str(trip)
    assert observed.state is STATES[action]
    assert not observed.check(100, 0.0)


def test_limit_counts_again_for_a_severer_action_only():
    """The ramp that a predicted displacement begins leads nowhere when the table does not follow it."""
    observed = supervisor(displacement_limit=0.1, stale_controller_action="ignore")
    steps = iter(range(1000))
    while observed.check(next(steps), 5.0):
        pass
    ramping = observed.advance()
    assert (observed.state, observed.emergency) == (State.RAMPING, False)
    for _ in range(2):
        observed.observe(measurement(ramping.step, displacement=0.11))
    assert (observed.state, observed.emergency) == (State.STOPPED, True)
    assert [trip.action for trip in observed.trips] == [Action.RAMP, Action.EMERGENCY_STOP]
    assert observed.reason == str(observed.trips[0])
    assert observed.advance() is None


@pytest.mark.parametrize("case", CASES)
def test_limit_that_is_only_indicated_does_not_stop(case):
    changes, happen, step, *_ = CASES[case]
    limit = {"negative acceleration": "acceleration", "silent shear": "stale_shear"}.get(case, case)
    observed = supervisor(**changes, **{f"{limit}_action": "indicate"})
    rest(observed, 5)
    happen(observed)
    assert [trip.step for trip in observed.trips] == [step]
    assert str(observed.trips[0]).endswith("; indicated")
    assert (observed.state, observed.reason) == (State.INDICATING, "")
    assert observed.check(step + 1, 0.0)


@pytest.mark.parametrize("case", CASES)
def test_limit_that_is_ignored_says_nothing(case):
    changes, happen, *_ = CASES[case]
    limit = {"negative acceleration": "acceleration", "silent shear": "stale_shear"}.get(case, case)
    observed = supervisor(**changes, **{f"{limit}_action": "ignore"})
    rest(observed, 5)
    happen(observed)
    assert (observed.trips, observed.state) == ((), State.NORMAL)


@pytest.mark.parametrize("case", CASES)
def test_what_keeps_the_limit_does_not_trip(case):
    """The same happens under a limit that is larger by a little."""
    changes, happen, _, _, value, _ = CASES[case]
    limit = {"negative acceleration": "acceleration", "silent shear": "stale_shear"}.get(case, case)
    allowed = value if limit.startswith("stale") else abs(value) + 1e-9
    observed = supervisor(**{**changes, parameter_of(limit): allowed})
    rest(observed, 5)
    happen(observed)
    assert observed.trips == ()


# ---- values that are not finite


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_command_that_is_not_finite_is_never_passed_on(value):
    observed = supervisor()
    rest(observed, 5)
    assert observed.check(5, 0.5)
    assert not observed.check(6, value)
    assert observed.reason == f"safety.non_finite_action: command at step 6 is {value}, not finite; ramp to rest"
    commands = way_to_rest(observed)
    assert [command.step for command in commands] == list(range(6, 6 + len(commands)))
    assert all(math.isfinite(command.acceleration) for command in commands)


SENSORS = ("displacement", "acceleration", "force", "shear", "floors")


@pytest.mark.parametrize("sensor", SENSORS)
def test_sensor_that_falls_silent_trips_and_one_that_was_never_there_does_not(sensor):
    lost = {sensor: (0.0, math.nan) if sensor == "floors" else math.nan}
    observed = supervisor()
    for step in range(5):
        assert observed.check(step, 0.0)
        observed.observe(measurement(step, **lost))
    assert observed.trips == ()
    observed.reset()
    rest(observed, 5)
    assert observed.check(5, 0.0)
    observed.observe(measurement(5, **lost))
    assert "at step 5 is nan, not finite" in observed.reason
    assert not observed.check(6, 0.0)


@pytest.mark.parametrize("sensor", SENSORS)
def test_infinite_sensor_trips_always(sensor):
    observed = supervisor()
    assert observed.check(0, 0.0)
    observed.observe(measurement(0, **{sensor: (math.inf, 0.0) if sensor == "floors" else math.inf}))
    assert not observed.check(1, 0.0)


def test_nothing_but_a_stop_is_allowed_for_values_that_are_not_finite():
    for action in ("ignore", "indicate"):
        with pytest.raises(InputError, match=r"safety.non_finite_action: .* one of hold, ramp, emergency_stop"):
            SafetyConfig(non_finite_action=action)


# ---- latch, order of severity, requests


def test_trips_are_latched_until_reset():
    observed = supervisor(acceleration_limit=1.0, ramp_acceleration=1.0)
    rest(observed, 3)
    assert not observed.check(3, 2.0)
    first = observed.trips
    way_to_rest(observed)
    for step in range(2000, 2010):
        assert not observed.check(step, 0.0)
        observed.observe(measurement(step))
        assert observed.advance() is None
    assert observed.trips == first
    observed.reset()
    assert (observed.trips, observed.state, observed.reason) == ((), State.NORMAL, "")
    rest(observed, 3)


@pytest.mark.parametrize("before", [(), (Action.HOLD,), (Action.RAMP,)])
def test_nothing_moves_after_an_emergency_stop(before):
    observed = supervisor()
    rest(observed, 3)
    assert observed.check(3, 1.0)
    for action in before:
        observed.request(action)
        assert observed.advance() is not None
    observed.request(Action.EMERGENCY_STOP)
    assert observed.at_rest
    for action in STOPPING:
        observed.request(action)
        assert observed.advance() is None
        assert not observed.check(1000 + action, 0.0)


def test_severer_limit_takes_over_and_a_milder_one_does_not():
    holds = {f"{limit}_action": "hold" for limit in ("acceleration", "increment", "displacement")}
    observed = supervisor(force_action="emergency_stop", **holds)
    rest(observed, 3)
    assert observed.check(3, 1.0)
    assert not observed.check(4, 30.0)
    assert observed.state is State.HOLDING
    command = observed.advance()
    observed.observe(measurement(command.step, command.acceleration, displacement=0.3, force=1e6))
    assert observed.state is State.STOPPED
    assert observed.advance() is None
    limits = ["safety.acceleration_limit", "safety.increment_limit", "safety.displacement_limit", "safety.force_limit"]
    assert {trip.limit for trip in observed.trips} == set(limits)


def test_severest_action_of_one_step_is_taken():
    observed = supervisor(acceleration_action="indicate", increment_action="hold")
    rest(observed, 3)
    assert not observed.check(3, 25.0)
    assert observed.state in (State.HOLDING, State.RAMPING)
    assert observed.trips[0].action is Action.INDICATE
    assert observed.reason.startswith("safety.increment_limit")


def test_hold_stays_with_zero_acceleration_until_the_operator_ramps():
    observed = supervisor()
    for step in range(60):
        assert observed.check(step, 0.5)
        observed.observe(measurement(step, 0.5, math.nan, 0.5))
    observed.request(Action.HOLD)
    held = way_to_rest(observed)
    assert observed.at_rest
    observed.observe(measurement(held[-1].step))
    assert [observed.advance().acceleration for _ in range(5)] == [0.0] * 5
    observed.request(Action.RAMP)
    ramp = way_to_rest(observed)
    accelerations = np.array([0.5] * 60 + [c.acceleration for c in held] + [0.0] * 5 + [c.acceleration for c in ramp])
    velocity = DT * np.cumsum(accelerations)
    displacement = DT * np.cumsum(velocity) - 0.5 * DT**2 * np.cumsum(accelerations)
    assert abs(velocity[-1]) < 1e-12
    assert abs(displacement[-1]) < 1e-12
    assert observed.state is State.STOPPED


def test_commands_held_by_the_table_are_part_of_the_motion():
    """Ten steps of 0.5 m/s² are held by the table for ten more: the ramp takes that motion away too."""
    observed = supervisor(stale_shear_time=0.025)
    for step in range(10):
        assert observed.check(step, 0.5)
    assert not observed.goes_on_without(10 * DT)
    way = [observed.advance(10 * DT), *way_to_rest(observed)]
    assert way[0].step == 20
    accelerations = np.array([0.5] * 20 + [command.acceleration for command in way])
    velocity = DT * np.cumsum(accelerations)
    assert abs(velocity[-1]) < 1e-12
    assert abs(DT * velocity.sum() - 0.5 * DT**2 * accelerations.sum()) < 1e-12


def test_step_of_the_past_is_refused():
    observed = supervisor()
    rest(observed, 3)
    with pytest.raises(ValueError, match="command of step 2 comes after that of step 2"):
        observed.check(2, 0.0)


def test_trip_found_elsewhere_begins_its_action():
    observed = supervisor()
    observed.record([Trip("safety.stability_limit", "1", "stability indicator", 0.8, 0.7, 9, Action.RAMP)])
    assert observed.state is State.RAMPING
    assert not observed.check(9, 0.0)


# ---- with the simulated table


TIGHT = {"safety__acceleration_limit": 1.0, "safety__ramp_acceleration": 1.0}


class TableThatStaysOn(SimulatedTable):
    """Can be asked where it stands after the test."""

    def stop(self):
        """Go on."""

    close = stop

    def displacement(self, step):
        return self.exchange(TableCommand(step, 0.0)).table_displacement


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, TIGHT, {"safety__velocity_limit": 0.1, "safety__ramp_velocity": 0.1}])
def test_simulated_table_is_at_rest_at_zero_after_every_test(changes):
    """The servo has unit gain at zero frequency: when the commands leave nothing, it does not either."""
    config = Config().changed(simulated_table__displacement_noise=0.0, **changes)
    table = TableThatStaysOn(config.simulated_table, config.specimen.building(), DT, 0)
    record = RthsLoop(config, EL_CENTRO, table).run()
    assert record.outcome == ("limit" if changes else "finished")
    assert np.nanmax(np.abs(record.table_displacement)) > 1e-3
    assert abs(table.displacement(10000)) < 1e-9
    assert abs(table.displacement(20000)) < 1e-9


def test_table_stands_before_it_is_moved_and_when_it_was_brought_to_rest():
    observed = supervisor()
    assert observed.stands
    for step, command in enumerate((1.0, -1.0, 0.0)):  # at rest again, and off zero by a small way
        assert observed.check(step, command)
        assert not observed.stands
    observed.request(Action.RAMP)
    assert way_to_rest(observed)
    assert observed.stands
