"""A sensor that keeps its value while the table is moved; one that never changed is a channel that is not there."""

import math

import numpy as np
import pytest

from bmd_rths_core.safety import Action, SafetyConfig
from bmd_rths_core.safety.stuck_sensors import StuckSensorCheck
from bmd_rths_core.table.controller import TableMeasurement

DT = 0.005
NAMES = (
    *("table displacement", "table acceleration", "actuator force", "base shear"),
    *("acceleration of floor 1", "acceleration of floor 2"),
)


def measurement(step, stuck=(), command=None, since=300):
    """Return sensors that all move, except the stuck ones from a step on."""
    values = [math.sin(0.1 * (min(step, since) if i in stuck else step) + i) for i in range(6)]
    command = math.sin(0.1 * step) if command is None else command
    return TableMeasurement(step, command, *values[:4], np.array(values[4:]))


def trips(check, measurements):
    return [trip for m in measurements for trip in check.step(m)]


@pytest.mark.parametrize("sensor", range(6))
def test_each_sensor_is_told_by_name_after_the_limit(sensor):
    check = StuckSensorCheck(SafetyConfig(stuck_time=0.2), DT)
    first = trips(check, (measurement(k, (sensor,)) for k in range(342)))[0]
    assert first.step == 341  # the value of step 300 is kept from 301 on
    assert (first.value, first.allowed, first.unit) == (pytest.approx(41 * DT), 0.2, "s")
    assert first.limit == "safety.stuck_time"
    assert f"the {NAMES[sensor]} stayed" in str(first)
    assert first.action is Action.RAMP


def test_sensors_that_move_and_one_that_was_never_there_do_not_trip():
    check = StuckSensorCheck(SafetyConfig(stuck_time=0.05), DT)
    silent = [measurement(k, (2, 4), since=0) for k in range(600)]
    assert trips(check, silent) == []
    missing = [m._replace(base_shear=math.nan, floor_accelerations=np.full(2, math.nan)) for m in silent]
    assert trips(StuckSensorCheck(SafetyConfig(stuck_time=0.05), DT), missing) == []


def test_table_that_is_not_moved_may_stand_still():
    check = StuckSensorCheck(SafetyConfig(stuck_time=0.05), DT)
    moving = [measurement(k, range(6)) for k in range(300)]
    standing = [measurement(k, range(6), command=0.0) for k in range(300, 3000)]
    found = trips(check, moving + standing[1500:])
    assert found[0].step < 2300  # what the mean square of one second still calls motion
    check.reset()
    assert trips(check, (measurement(k, range(6), command=0.0) for k in range(3000))) == []


def test_command_that_is_not_finite_does_not_blind_it():
    check = StuckSensorCheck(SafetyConfig(stuck_time=0.2), DT)
    stream = [measurement(k, (0,), command=math.nan if k == 5 else None) for k in range(400)]
    assert trips(check, stream)


def test_ignored_limit_says_nothing():
    check = StuckSensorCheck(SafetyConfig(stuck_time=0.025, stuck_action="ignore"), DT)
    assert trips(check, (measurement(k, (0,)) for k in range(600))) == []
