"""Table and specimen fitted together: what they were comes back, with the deviations that are told."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.config import load_config
from bmd_rths_core.identification.excitation import ExcitationSettings, excitation_command
from bmd_rths_core.identification.joint_model import identify_joint
from bmd_rths_core.identification.joint_tables import SERVO, FittedSections, FittedServo, servo_response
from bmd_rths_core.identification.output import model_text
from bmd_rths_core.identification.specimen_model import (
    floor_transmissibility,
    identify_specimen,
    transmissibility_changes,
)
from bmd_rths_core.identification.table_model import identify_table
from bmd_rths_core.loop.build import make_known
from bmd_rths_core.structure.shear_building import ShearBuilding
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
    [(FittedServo(), np.array([0.97, 50.0, 120.0, 0.2, 1900.0, 0.003])), (SECTIONS, SECTIONS.values)],
    ids=["servo", "sections"],
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
