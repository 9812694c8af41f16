"""A table known by its measured frequency response: fitted once, told how well, and taken wherever a model is."""

from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.config import Config, config_from_mapping, dump_config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import GroundMotion
from bmd_rths_core.identification.frequency_response import FrequencyResponse
from bmd_rths_core.identification.measured_table import fit_response, with_fitted_table
from bmd_rths_core.identification.output import frequency_response_text
from bmd_rths_core.loop.build import make_virtual_controller
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.analysed_loops import AnalysisOptions
from bmd_rths_core.stability.assessment import assess
from bmd_rths_core.stability.models import EQUATION_9, table_sections
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.response_file import read_response

DELAY = 0.004


def truth(omega):
    """Eq. 9 of the paper behind a pure delay."""
    return table_sections(EQUATION_9).response(omega) * np.exp(-1j * omega * DELAY)


def measured(noise=0.0, points=300, coherence=True):
    omega = 2 * np.pi * np.linspace(0.2, 30.0, points)
    random = np.random.default_rng(0)
    exact = truth(omega)
    error = noise * np.abs(exact) * (random.standard_normal(points) + 1j * random.standard_normal(points)) / np.sqrt(2)
    gamma = np.full(points, 1.0 / (1.0 + noise**2)) if coherence else np.ones(points)
    return FrequencyResponse(omega, (exact + error)[:, None], gamma[:, None])


def write(path, response, with_coherence=True):
    lines = frequency_response_text(response).splitlines()
    path.write_text("\n".join(line if with_coherence else line.rpartition(",")[0] for line in lines) + "\n")
    return str(path)


def of(path, **others):
    table = {"dynamics": "measured", "frequency_response": path}
    return config_from_mapping({"simulated_table": table, **others})


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    return write(tmp_path_factory.mktemp("frf") / "table.csv", measured(noise=0.01))


@pytest.fixture(scope="module")
def fitted(noisy):
    return with_fitted_table(of(noisy))


def test_the_fit_is_the_table_within_its_noise(fitted):
    table, omega = fitted.simulated_table, 2 * np.pi * np.linspace(0.5, 28.0, 200)
    model = table_sections(table.sections).response(omega) * np.exp(-1j * omega * table.command_delay)
    assert np.abs(model / truth(omega) - 1.0).max() < 0.02
    assert table.fit_error == pytest.approx(0.01, rel=0.15)


def test_a_response_without_noise_and_without_coherence_is_met(tmp_path):
    path = write(tmp_path / "table.csv", measured(), with_coherence=False)
    assert read_response(path).coherence is None
    model = fit_response(read_response(path), 0.005)
    assert model.fit_error < 1e-3
    assert model.delay.seconds == pytest.approx(0.022, abs=0.01)


def test_it_is_fitted_once(fitted, noisy, tmp_path):
    assert with_fitted_table(fitted) is fitted
    copy = tmp_path / "copy.yaml"
    copy.write_text(dump_config(fitted))
    assert load_config(copy) == fitted
    assert with_fitted_table(Config()) == Config()
    other = fitted.changed(simulated_table__frequency_response=noisy)
    assert other.simulated_table.sections == ()
    assert other.simulated_table.fit_error == 0.0


def test_simulation_stability_and_emulator_take_it(fitted):
    config = fitted.changed(force_correction__feedback_scale=0.1)
    ground = GroundMotion("test", 0.005, 0.3 * np.sin(np.arange(300) * 0.05), "test", "0" * 64)
    assert RthsLoop(config, ground).run().outcome == "finished"
    assessment = assess(config, AnalysisOptions())
    assert set(assessment.analyses) == {"continuous", "continuous_complete", "discrete"}
    assert assessment.go
    assert config.virtual_controller.model == "servo"
    make_virtual_controller(config, Faults())


def test_a_file_beside_the_configuration_is_found(tmp_path, noisy):
    (tmp_path / "table.csv").write_text(Path(noisy).read_text())
    path = tmp_path / "rig.yaml"
    path.write_text("/**: {ros__parameters: {simulated_table: {dynamics: measured, frequency_response: table.csv}}}")
    assert load_config(path).simulated_table.frequency_response == str(tmp_path / "table.csv")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "No such file"),
        ("frequency_hz,magnitude,phase_deg\n1,1,0\n2,1,-5\n", "2 frequencies have a coherence of 0.8 or more"),
        ("frequency_hz,magnitude,phase_deg,coherence\n1,1,0,1.2\n2,1,0,1\n", "line 2: coherence 1.2 is not allowed"),
        ("frequency_hz,magnitude\n1,1\n2,1\n", "line 1: 0 columns phase_deg"),
    ],
)
def test_a_response_that_bears_no_fit_is_told_in_one_line(tmp_path, content, message):
    path = tmp_path / "table.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError) as error:
        with_fitted_table(of(str(path)))
    assert str(error.value).startswith("simulated_table.frequency_response: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_table_that_moves_against_its_command_is_refused(tmp_path):
    exact = measured()
    path = write(tmp_path / "table.csv", FrequencyResponse(exact.frequencies, -exact.response, exact.coherence))
    with pytest.raises(InputError, match="polarity of command or accelerometer is wrong"):
        with_fitted_table(of(path))


def test_a_measured_table_needs_its_file():
    with pytest.raises(InputError, match=r"simulated_table\.frequency_response: none"):
        config_from_mapping({"simulated_table": {"dynamics": "measured"}})
