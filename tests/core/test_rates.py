"""Limits that mean a time: another rate of the loop changes nothing else. In virtual time, at 200, 500 and 1000 Hz."""

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_command_shaper, make_supervisor, make_table_controller
from bmd_rths_core.loop.deadlines import DeadlineMonitor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.safety import State
from bmd_rths_core.table.controller import TableMeasurement
from tests.core.test_loop import synthetic

RATES = [200, 500, 1000]
DEFAULTS = Config()


def at(rate, **changes):
    return DEFAULTS.changed(run__time_step=1.0 / rate, **changes)


def heard(step, command=0.0):
    return TableMeasurement(step, command, 0.0, 0.0, 0.0, 0.0, np.zeros(2))


def running(config, steps):
    """Return a supervisor after some good steps at rest."""
    supervisor = make_supervisor(config)
    for step in range(steps):
        assert supervisor.check(step, 0.0)
        supervisor.observe(heard(step))
    return supervisor


def silent_until_trip(config, what):
    """Return time and trip of a silence that lasts one step more with every try."""
    for silent in range(1, 1000):
        supervisor = running(config, 10)
        if what == "silence":
            supervisor.goes_on_without(silent * config.run.time_step)
        elif what == "gap":
            supervisor.check(10 + silent, 0.0)
        else:
            for k in range(silent + 1):
                supervisor.check(10 + k, 0.0)
        if supervisor.trips:
            return silent * config.run.time_step, supervisor
    raise AssertionError("nothing trips")


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(
    ("what", "limit", "allowed", "state"),
    [
        ("silence", "stale_shear_time", DEFAULTS.safety.stale_shear_time, State.RAMPING),
        ("gap", "stale_shear_time", DEFAULTS.safety.stale_shear_time, State.RAMPING),
        ("unheard", "stale_controller_time", DEFAULTS.safety.stale_controller_time, State.STOPPED),
    ],
)
def test_silence_trips_with_the_first_step_beyond_the_same_time(rate, what, limit, allowed, state):
    time, supervisor = silent_until_trip(at(rate), what)
    assert time == pytest.approx(allowed + 1.0 / rate, rel=1e-12)
    (trip,) = supervisor.trips
    assert (trip.limit, trip.unit, trip.allowed) == (f"safety.{limit}", "s", allowed)
    assert trip.value == pytest.approx(time, rel=1e-12)
    assert supervisor.state is state


@pytest.mark.parametrize("rate", RATES)
def test_pause_that_a_loop_at_200_hz_survives_ends_none(rate):
    """A stall of 80 ms is 16 steps at 200 Hz and 80 at 1000 Hz."""
    supervisor = running(at(rate), 10)
    stall = round(0.08 * rate)
    assert supervisor.goes_on_without(stall / rate)
    assert supervisor.check(10 + stall, 0.0)
    supervisor.observe(heard(10 + stall))
    assert supervisor.trips == ()


@pytest.mark.parametrize("rate", RATES)
def test_deadlines_may_be_missed_for_the_same_time(rate):
    config = at(rate)
    monitor = DeadlineMonitor(config.run.time_step, config.run.longest_miss_time)  # as the conductor makes it
    for step in range(1000):
        now, deadline = step / rate, (step + 1) / rate
        monitor.expired(now)
        if monitor.exhausted(now, deadline):
            break
        monitor.opened(step, now, deadline)
    # The first deadline is that of step 0, after one step.
    assert step / rate == pytest.approx(config.run.longest_miss_time + 1.0 / rate, rel=1e-12)


class StuckTable:
    """A table controller whose sensor of displacement keeps its value from a time on."""

    def __init__(self, controller, step):
        self._controller, self._step, self._last = controller, step, 0.0

    def __getattr__(self, name):
        return getattr(self._controller, name)

    def exchange(self, command):
        measurement = self._controller.exchange(command)
        if command.step < self._step:
            self._last = measurement.table_displacement
        return measurement._replace(table_displacement=self._last)


@pytest.mark.parametrize("rate", RATES)
def test_loop_with_a_stuck_sensor_ends_after_the_same_time(rate):
    config = at(rate, run__scheme="uc")
    table = StuckTable(make_table_controller(config), round(1.0 * rate))
    record = RthsLoop(config, synthetic(1.0 / rate), table).run()
    assert record.outcome == "limit"
    assert record.reason.startswith("safety.stuck_time [s] passed at step")
    # The value of step 1 s - Δt is kept; the command of the step after the trip is refused and is the last one.
    assert (record.steps - 1) / rate == pytest.approx(1.0 + config.safety.stuck_time + 1.0 / rate, rel=1e-12)


@pytest.mark.parametrize("rate", RATES)
def test_lead_of_the_compensator_is_the_same_time(rate):
    shaper = make_command_shaper(at(rate)).state_space()
    frequency = 0.01
    z = np.exp(2j * np.pi * frequency / rate)
    response = shaper.c @ np.linalg.solve(z * np.eye(2) - shaper.a, shaper.b) + shaper.d
    lead = np.angle(response.item()) / (2.0 * np.pi * frequency)
    assert lead == pytest.approx(DEFAULTS.command_shaper.lead_time, rel=1e-4)


def test_time_of_less_than_a_step_is_refused_for_stuck_sensors():
    with pytest.raises(InputError, match=r"safety\.stuck_time: 0\.001 s is less than one time step; run\.time_step"):
        DEFAULTS.changed(safety__stuck_time=0.001)


@pytest.mark.parametrize("rate", RATES)
def test_the_emulator_leaves_the_same_share_of_a_step(rate):
    config = at(rate)
    assert config.virtual_controller.answer_after == pytest.approx(min(0.6 / rate, 0.003), rel=1e-12)
    assert config.changed(run__scheme="uc").virtual_controller == config.virtual_controller
    chosen = config.changed(virtual_controller__answer_after=0.25 / rate)
    assert chosen.changed(run__time_step=0.5 / rate).virtual_controller.answer_after == 0.25 / rate


def test_an_answer_that_comes_after_its_step_is_refused():
    message = r"virtual_controller\.answer_after: 0\.005 s; less than one time step, 0\.005 s, is required"
    with pytest.raises(InputError, match=message):
        DEFAULTS.changed(virtual_controller__answer_after=0.005)
