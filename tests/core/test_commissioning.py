"""Calibration of the sensors, and what commissioning finds of them."""

import dataclasses

import numpy as np
import pytest

from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import GroundMotion
from bmd_rths_core.identification.commissioning import (
    LIMITS,
    at_rest,
    polarity_and_scale,
    pulse_commands,
    try_limit,
)
from bmd_rths_core.identification.excited_table import drive
from bmd_rths_core.loop.build import make_calibration, make_supervisor, make_table_controller
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.controller import TableMeasurement

READING = TableMeasurement(3, 0.5, 0.01, 0.6, 900.0, -700.0, np.array([0.7, 0.8]))


def with_sensors(**values):
    return config_from_mapping({"sensors": values})


def pulsed(config):
    return drive(
        make_table_controller(config),
        make_supervisor(config),
        pulse_commands(config),
        config.run.time_step,
        calibration=make_calibration(config),
    )


def failed(findings):
    return [finding.step for finding in findings if not finding.passed]


def test_readings_become_si_units_and_back():
    config = with_sensors(table_displacement_scale=1e-3, table_displacement_offset=2.0, floor_scales=[-1.0, 9.81])
    calibration = make_calibration(config)
    measured = calibration.calibrated(READING._replace(table_displacement=52.0))
    assert measured.table_displacement == pytest.approx(0.05)
    assert measured.floor_accelerations == pytest.approx([-0.7, 9.81 * 0.8])
    assert (measured.step, measured.applied_command, measured.base_shear) == (3, 0.5, -700.0)
    assert calibration.reading(measured).table_displacement == pytest.approx(52.0)
    assert calibration.reading(measured).floor_accelerations == pytest.approx(READING.floor_accelerations)


def test_without_a_calibration_a_reading_is_the_measurement_itself():
    assert make_calibration(Config()).calibrated(READING) is READING


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"base_shear_scale": 0.0}, "sensors.base_shear_scale: 0 is not allowed"),
        ({"floor_scales": [1.0]}, "sensors.floor_scales: 1 entries; 2, one a floor of the specimen, or none"),
        ({"floor_scales": [1.0, 0.0]}, "sensors.floor_scales: 0 is not allowed"),
        ({"calibrated_on": ""}, "sensors.calibrated_on: empty"),
    ],
)
def test_wrong_calibrations_are_refused_in_one_line(values, message):
    with pytest.raises(InputError) as error:
        with_sensors(**values)
    assert message in str(error.value)


def test_the_loop_runs_on_calibrated_values():
    """A displacement in millimetres with its scale is the same test; without it the limit trips at once."""
    ground = GroundMotion("test", 0.005, 0.2 * np.sin(np.arange(200) * 0.05), "test", "0" * 64)
    plain = RthsLoop(Config(), ground).run()

    class InMillimetres(type(make_table_controller(Config()))):
        def exchange(self, command):
            measured = super().exchange(command)
            return measured._replace(table_displacement=1e3 * measured.table_displacement)

    table = Config(), Config().specimen.building()
    inside = [InMillimetres(table[0].simulated_table, table[1], 0.005, 0) for _ in range(2)]
    scaled = RthsLoop(with_sensors(table_displacement_scale=1e-3), ground, inside[0]).run()
    assert scaled.table_displacement == pytest.approx(plain.table_displacement, abs=1e-15)
    assert np.array_equal(scaled.command, plain.command)
    assert RthsLoop(Config(), ground, inside[1]).run().outcome == "limit"


def test_sensors_in_order_pass():
    config = Config()
    responses = pulsed(config)
    assert failed([*at_rest(responses, config), *polarity_and_scale(responses, config)]) == []


@pytest.mark.parametrize(
    ("values", "steps"),
    [
        ({"floor_scales": [1.0, -1.0]}, ["polarity, accelerometer of floor 2"]),
        ({"base_shear_scale": -1.0}, ["polarity, load cells"]),
        ({"table_acceleration_scale": 2.0}, ["scale against the displacement"]),
        ({"table_displacement_offset": 0.003}, ["noise floor and zero, displacement of the table"]),
    ],
)
def test_a_sensor_that_is_wrong_is_found(values, steps):
    """The calibration is wrong, the sensors of the simulated table are right."""
    config = with_sensors(**values)
    responses = pulsed(config)
    assert failed([*at_rest(responses, config), *polarity_and_scale(responses, config)]) == steps


# The force comes near its limit slowly.
@pytest.mark.parametrize("limit", [pytest.param(x, marks=pytest.mark.slow) if x == "force" else x for x in LIMITS])
def test_every_limit_trips_when_it_is_passed(limit):
    finding = try_limit(Config(), limit)
    assert finding.passed, finding
    assert f"safety.{limit}_limit" in finding.told


def test_pulses_begin_and_end_at_rest():
    commands = pulse_commands(Config())
    velocity = np.cumsum(commands) * 0.005
    assert velocity[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.cumsum(velocity).max() * 0.005 == pytest.approx(0.023, rel=0.02)
    assert dataclasses.asdict(try_limit(Config(), "velocity"))["passed"]
