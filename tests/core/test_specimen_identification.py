"""Identification of the simulated specimen, sensor noise on: Table 1 comes back, with honest deviations."""

from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.excitation import ExcitationSettings, excitation_command
from bmd_rths_core.identification.specimen_model import identify_specimen
from tests.core.simulated_responses import simulated_responses

DT = 0.005
BAND = (2.0 * np.pi * 0.5, 2.0 * np.pi * 25.0)
SIMPLIFIED = Config()
EIGHT_STORY = load_config(Path(__file__).parents[2] / "config" / "eight_story_bmd.yaml")


def identified(config, seed=0, masses=None, **settings):
    command = excitation_command(ExcitationSettings(seed=seed, **settings), DT)
    responses = simulated_responses(config.changed(run__seed=seed), command)
    return identify_specimen(responses, config.specimen.masses if masses is None else masses, BAND)


def true_poles(config):
    """Return the complex eigenvalues of the specimen, whose damping is not classical."""
    eigenvalues = np.linalg.eigvals(config.specimen.building().relative_motion()[0])
    upper = eigenvalues[eigenvalues.imag > 0.0]
    return upper[np.argsort(np.abs(upper))]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_table_1_comes_back(seed):
    model = identified(SIMPLIFIED, seed)
    assert model.building.stiffnesses == pytest.approx((2495320.0, 4941700.0), rel=5e-4)
    assert model.building.damping_coefficients == pytest.approx((3330.0, 78.0), abs=15.0)
    poles = true_poles(SIMPLIFIED)
    assert model.frequencies == pytest.approx(np.abs(poles), rel=5e-4)
    assert model.damping_ratios == pytest.approx(-poles.real / np.abs(poles), abs=3e-4)


@pytest.mark.slow
def test_eight_story_specimen():
    model = identified(EIGHT_STORY)
    assert model.building.stiffnesses == pytest.approx(EIGHT_STORY.specimen.stiffnesses, rel=1e-3)
    assert model.building.damping_coefficients == pytest.approx(EIGHT_STORY.specimen.damping_coefficients, abs=15.0)
    poles = true_poles(EIGHT_STORY)
    assert model.frequencies == pytest.approx(np.abs(poles), rel=5e-4)
    assert model.damping_ratios == pytest.approx(-poles.real / np.abs(poles), abs=3e-4)


@pytest.mark.slow
def test_deviations_are_honest():
    """Errors over their stated deviations are standard normal: mean square 1 within 4 deviations of itself."""
    true = np.array([2495320.0, 4941700.0, 3330.0, 78.0])
    scores = []
    for seed in range(12):
        model = identified(SIMPLIFIED, seed, duration=60.0)
        found = np.concatenate((model.building.stiffnesses, model.building.damping_coefficients))
        stated = np.concatenate((model.stiffness_deviations, model.damping_deviations))
        scores.append((found - true) / stated)
    squares = np.square(scores)
    assert squares.mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / squares.size))


@pytest.mark.slow
def test_stiffness_is_proportional_to_the_given_masses():
    once = identified(SIMPLIFIED, duration=60.0)
    twice = identified(SIMPLIFIED, masses=(1520.0, 1600.0), duration=60.0)
    assert twice.building.stiffnesses == pytest.approx([2 * k for k in once.building.stiffnesses], rel=1e-6)
    assert twice.frequencies == pytest.approx(once.frequencies, rel=1e-6)


def test_parameters_make_the_section_of_a_configuration():
    model = identified(SIMPLIFIED, duration=60.0)
    values = model.parameters()["specimen"]
    config = SIMPLIFIED.changed(**{f"specimen__{key}": value for key, value in values.items()})
    assert config.specimen.building().stiffnesses == pytest.approx(model.building.stiffnesses, rel=1e-6)
    assert config.specimen.identified_frequency == pytest.approx(model.frequencies[0], rel=1e-5)
    assert config.specimen.identified_damping_ratio == pytest.approx(model.damping_ratios[0], rel=1e-3)


def test_other_number_of_floors_is_refused_in_one_line():
    with pytest.raises(InputError, match="2 floors were measured, the configuration has 3") as error:
        identified(SIMPLIFIED, masses=(1.0, 1.0, 1.0), duration=30.0)
    assert "\n" not in str(error.value)
