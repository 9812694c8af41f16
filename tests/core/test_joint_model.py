"""Table and specimen fitted together: what they were comes back, with the deviations that are told."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.analysis.true_building import simulated_references_of
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.identification.excitation import ExcitationSettings, excitation_command
from bmd_rths_core.identification.excited_table import drive
from bmd_rths_core.identification.joint_model import identify_joint
from bmd_rths_core.identification.joint_tables import (
    SERVO,
    FittedHydraulicServo,
    FittedSections,
    FittedServo,
    hydraulic_response,
    servo_response,
)
from bmd_rths_core.identification.output import model_text
from bmd_rths_core.identification.specimen_model import (
    floor_transmissibility,
    identify_specimen,
    transmissibility_changes,
)
from bmd_rths_core.identification.table_model import identify_table
from bmd_rths_core.loop.build import make_command_shaper, make_interface_control, make_known, make_supervisor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.models.servo_hydraulic import ServoHydraulicTable
from tests.core.simulated_responses import simulated_responses

CONFIGS = Path(__file__).parents[2] / "config"
BAND = (2.0 * np.pi * 0.5, 2.0 * np.pi * 25.0)


#: The fit of nine sections takes several seconds.
SYSTEMS = ["simplified_bmd", pytest.param("eight_story_bmd", marks=pytest.mark.slow)]


@cache
def identified(name, **changes):
    config = load_config(CONFIGS / f"{name}.yaml").changed(**changes)
    command = excitation_command(ExcitationSettings(duration=120.0), config.run.time_step)
    responses = simulated_responses(config, command)
    table = identify_table(responses, BAND, (BAND[0], 2.0 * np.pi * 8.0))
    return config, identify_joint(responses, table, identify_specimen(responses, config.specimen.masses, BAND), BAND)


def true_stories(config):
    specimen = config.simulated_table.specimen(config.specimen.building())
    return np.concatenate((specimen.stiffnesses, specimen.damping_coefficients))


def found_stories(model):
    building = model.building
    deviations = np.concatenate((model.stiffness_deviations, model.damping_deviations))
    return np.concatenate((building.stiffnesses, building.damping_coefficients)), deviations


@pytest.mark.slow
def test_servo_and_specimen_come_back_within_their_deviations():
    config, model = identified("simplified_bmd")
    assert model.table == "interacting_servo"
    found, deviations = found_stories(model)
    assert np.all(np.abs(found - true_stories(config)) < 5.0 * deviations + 3e-4 * found)
    truth = {"gain": 1.0} | {name: getattr(config.simulated_table, name) for name in SERVO[1:-1]}
    for name, value in truth.items():
        assert model.servo[name] == pytest.approx(value, rel=2e-3), name
    assert model.command_delay < 2e-5


@pytest.mark.slow
def test_chain_of_sections_and_its_specimen_come_back():
    config, model = identified("eight_story_bmd")
    assert model.table == "sections"
    found, _ = found_stories(model)
    np.testing.assert_allclose(found[:5], true_stories(config)[:5], rtol=1e-3)
    np.testing.assert_allclose(found[5:], true_stories(config)[5:], rtol=0.15)


@pytest.mark.parametrize("name", SYSTEMS)
def test_noise_of_every_sensor_is_measured(name):
    config, model = identified(name)
    for sensor in ("acceleration_noise", "displacement_noise", "shear_noise"):
        assert model.noise[sensor] == pytest.approx(getattr(config.simulated_table, sensor), rel=0.05)


def test_response_of_the_servo_is_that_of_its_matrices():
    config, _ = identified("simplified_bmd")
    table, specimen = config.simulated_table, config.specimen.building()
    plant, frequencies = table.plant(specimen), np.linspace(1.0, 300.0, 50)
    size = len(plant.a) - 2
    expected = [
        plant.output[0, :size] @ np.linalg.solve(1j * w * np.eye(size) - plant.a[:size, :size], plant.b[:size, 0])
        for w in frequencies
    ]
    stories = np.concatenate((specimen.stiffnesses, specimen.damping_coefficients))
    masses = np.asarray(specimen.masses)
    apparent = floor_transmissibility(1j * frequencies, masses, stories)[:, 1:] @ masses
    servo = np.array(
        [1.0, table.servo_real_pole, table.servo_frequency, table.servo_damping_ratio, table.platen_mass, 0]
    )
    np.testing.assert_allclose(servo_response(frequencies, servo, apparent), expected, rtol=1e-9)


def hydraulic_truth():
    """Return an 8-story servo-hydraulic table whose linear part is a hydraulic servo, its specimen and the values."""
    config = load_config(CONFIGS / "eight_story_bmd.yaml").changed(
        **{f"servo_hydraulic__{name}": 0.0 for name in ("washout_frequency", "integral_gain", "viscous_damping")}
    )
    table, specimen = config.servo_hydraulic, config.specimen.building()
    leakage = 4.0 * table.bulk_modulus * table.leakage / table.oil_volume
    oil, valve = np.sqrt(table.oil_frequency_squared), (table.valve_frequency, table.valve_damping_ratio)
    values = (1.0, table.proportional_gain, oil, leakage, table.platen_mass, *valve, table.pressure_feedback, 0.0)
    sensors = config.simulated_table.sensors(specimen.stories, 0)
    return ServoHydraulicTable(table, sensors, specimen, config.run.time_step), specimen, np.array(values)


def test_response_of_the_hydraulic_servo_is_that_of_its_matrices_and_of_the_servo_hydraulic_table():
    table, specimen, values = hydraulic_truth()
    frequencies, masses = np.linspace(1.0, 300.0, 50), np.asarray(specimen.masses)
    stories = np.concatenate((specimen.stiffnesses, specimen.damping_coefficients))
    apparent = floor_transmissibility(1j * frequencies, masses, stories)[:, 1:] @ masses
    found = hydraulic_response(frequencies, values, apparent)
    np.testing.assert_allclose(found, table.frequency_response(frequencies), rtol=1e-9)
    plant, delay = FittedHydraulicServo().plant(values, specimen)
    size = len(plant.a) - 2
    expected = [
        plant.output[0, :size] @ np.linalg.solve(1j * w * np.eye(size) - plant.a[:size, :size], plant.b[:size, 0])
        for w in frequencies
    ]
    assert delay == 0.0
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.slow
def test_eight_story_building_on_a_hydraulic_table_is_identified_and_then_tested_without_a_limit():
    """Issue 14: what is below the band of the identification is not guessed; the table stays within its stroke."""
    config = load_config(CONFIGS / "eight_story_bmd.yaml").changed(shear_estimator__source="load_cell")
    specimen, sensors = config.specimen.building(), config.simulated_table.sensors(5, 0)
    table = ServoHydraulicTable(config.servo_hydraulic, sensors, specimen, config.run.time_step)
    command = excitation_command(ExcitationSettings(duration=60.0), config.run.time_step)
    responses = drive(table, make_supervisor(config), command, config.run.time_step)
    of_specimen = identify_specimen(responses, config.specimen.masses, BAND)
    of_table = identify_table(responses, BAND, (BAND[0], 2.0 * np.pi * 8.0))
    assert np.abs(of_table.rational.poles).min() > 0.1 * BAND[0]
    model = identify_joint(responses, of_table, of_specimen, BAND)
    assert model.table == "hydraulic_servo"
    np.testing.assert_allclose(model.building.stiffnesses, specimen.stiffnesses, rtol=3e-3)
    assert model.servo["valve_frequency"] == pytest.approx(config.servo_hydraulic.valve_frequency, rel=0.02)
    known = {f"identified_model__{name}": value for name, value in model.parameters()["identified_model"].items()}
    tested = config.changed(run__scheme="mpic", **known)
    motion = select_ground_motion(tested.ground_motion, tested.run.time_step)
    record = RthsLoop(tested, motion, table).run()
    (true,) = simulated_references_of([motion.acceleration], tested)
    assert record.outcome == "finished"
    assert rmse_percent(true[:, len(config.numerical_substructure.masses) - 1], record.desired_acceleration) < 9.0


FREQUENCIES = np.linspace(3.0, 150.0, 40)
MASSES = np.array([760.0, 800.0, 500.0])
STORIES = np.array([2.5e6, 4.9e6, 3.1e6, 3330.0, 780.0, 90.0])


def by_small_changes(function, values):
    """Return central differences of a complex function over every value, along the last axis."""
    steps = 1e-6 * values
    pairs = [(function(values + step), function(values - step)) for step in np.diag(steps)]
    return np.stack([(above - below) / (2.0 * step) for (above, below), step in zip(pairs, steps, strict=True)], -1)


def test_transmissibility_is_that_of_the_equation_of_motion_and_its_changes_are_small_differences():
    s = 1j * FREQUENCIES
    found, changes = transmissibility_changes(s, MASSES, STORIES)
    a, b, c = ShearBuilding(tuple(MASSES), tuple(STORIES[:3]), tuple(STORIES[3:])).relative_motion()
    expected = [(c @ np.linalg.solve(w * np.eye(6) - a, b))[:, 0] for w in s]
    np.testing.assert_allclose(found[:, 1:], expected, rtol=1e-9)
    np.testing.assert_array_equal(found, floor_transmissibility(s, MASSES, STORIES))
    small = by_small_changes(lambda values: floor_transmissibility(s, MASSES, values), STORIES)
    np.testing.assert_allclose(changes * STORIES, small * STORIES, rtol=1e-5, atol=1e-7 * np.abs(found).max())


SECTIONS = FittedSections((0.0, 0.0, 60.0, 0.0, 1.0, 60.0, 1.0, 1.2, 3051.0, 1.0, 1.1, 2995.0), 0.004)


@pytest.mark.parametrize(
    ("table", "values"),
    [
        (FittedServo(), np.array([0.97, 50.0, 120.0, 0.2, 1900.0, 0.003])),
        (FittedHydraulicServo(), np.array([0.97, 36.0, 157.0, 4.0, 5200.0, 115.0, 0.65, 1e-3, 0.003])),
        (SECTIONS, SECTIONS.values),
    ],
    ids=["servo", "hydraulic servo", "sections"],
)
def test_changes_of_a_table_are_small_differences(table, values):
    apparent = floor_transmissibility(1j * FREQUENCIES, MASSES, STORIES)[:, 1:] @ MASSES
    small = by_small_changes(lambda changed: table.response(FREQUENCIES, changed, apparent), values)
    changes = table.changes(FREQUENCIES, values, apparent)
    np.testing.assert_allclose(changes * values, small * values, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("name", SYSTEMS)
def test_model_is_what_a_compensator_gets(name, tmp_path):
    config, model = identified(name)
    path = tmp_path / "model.yaml"
    path.write_text(model_text(model.parameters(), ["by a test"]))
    merged = config.merged(path)
    known = make_known(merged)
    np.testing.assert_allclose(known.specimen.stiffnesses, model.building.stiffnesses, rtol=1e-6)
    assert known.table is not None
    assert merged.specimen == config.specimen  # the nominal specimen and the virtual laboratory stay
    assert merged.simulated_table == config.simulated_table


def test_hydraulic_servo_is_what_a_compensator_gets():
    _, specimen, values = hydraulic_truth()
    names = FittedHydraulicServo.names
    known = dict(zip(names, values.tolist(), strict=True)) | {"table": "hydraulic_servo", "gain": 0.9}
    config = load_config(CONFIGS / "eight_story_bmd.yaml").changed(
        run__scheme="mpic",
        identified_model__stiffnesses=(),
        identified_model__damping_coefficients=(),
        identified_model__table_deviations=(0.1,) * 9,
        **{f"identified_model__{name}": value for name, value in known.items()},
    )
    expected, _ = FittedHydraulicServo().plant(np.append(0.9, values[1:]), specimen)
    plant = make_known(config).table
    assert plant is not None
    for one, other in zip(plant, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    assert make_interface_control(config) is not None
    for scheme in ("plc_tuned", "inverse", "ff_lqg", "ats", "amb"):
        assert make_command_shaper(config.changed(run__scheme=scheme)) is not None
    with pytest.raises(InputError, match=r"table_deviations: 6 entries; 9 or none"):
        config.changed(identified_model__table_deviations=(0.1,) * 6)


def test_table_that_answers_slow_commands_the_wrong_way_is_refused():
    """A zero at +0.076 rad/s beside a pole at 0.012 led the emulator out of its stroke though its loop was stable."""
    sections = (0.0, 0.0, 60.0, 0.0, 1.0, 60.0, 0.0, 1.0, -0.0761, 0.0, 1.0, 0.012)
    known = {"identified_model__table": "sections", "identified_model__sections": sections}
    with pytest.raises(InputError, match=r"identified_model: the table moves against its command at 0.00025 Hz"):
        make_interface_control(Config().changed(run__scheme="mpic", **known))
    to_the_left = (*sections[:8], 0.0761, *sections[9:])
    assert make_interface_control(
        Config().changed(run__scheme="mpic", **known | {"identified_model__sections": to_the_left})
    )
