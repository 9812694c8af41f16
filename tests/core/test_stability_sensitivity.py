"""Sensitivity: every parameter of the loop and no other, and its margins against python-control."""

from pathlib import Path

import control
import pytest

from bmd_rths_core.config import Config, load_config
from bmd_rths_core.stability.analysed_loops import AnalysisOptions
from bmd_rths_core.stability.assessment import assess
from bmd_rths_core.stability.discrete import with_mass_ratio
from bmd_rths_core.stability.sensitivity import sensitivity
from tests.conftest import SERVO_TABLE

ONE_MODE = AnalysisOptions(modes="identified")
UNCOMPENSATED = Config().changed(run__scheme="uc", shear_estimator__source="load_cell", **SERVO_TABLE)
STORIES = {
    f"{section}.{name}[{i}]"
    for section, stories in (("numerical_substructure", 1), ("specimen", 2))
    for name in ("masses", "stiffnesses", "damping_coefficients")
    for i in range(stories)
}
SERVO = {f"simulated_table.servo_{name}" for name in ("real_pole", "frequency", "damping_ratio")}
IDENTIFIED = {"specimen.identified_frequency", "specimen.identified_damping_ratio"}
FACTORS = ("specimen_stiffness_factor", "specimen_damping_factor", "command_gain")
TABLE = {f"simulated_table.{name}" for name in FACTORS}
ALWAYS = STORIES | TABLE | {"run.time_step", "force_correction.feedback_scale"}
KALMAN = {"shear_estimator.sensor_noise", "shear_estimator.model_error"}
SHAPER = {"command_shaper.w1", "command_shaper.w2", "command_shaper.lead_time"}


def by_name(config, options=ONE_MODE):
    return {entry.parameter: entry for entry in sensitivity(config, options)}


def allowable_by_control(servo_frequency, specimen_damping=0.0214):
    """Return the allowable mass ratio of Eqs. 7 and 8 without compensation, as a gain margin of python-control."""
    numerical = control.tf([1, 0, 0], [1, 2 * 0.0167 * 94.09, 94.09**2])
    damping = 2 * specimen_damping * 37.31
    experimental = control.tf([damping, 37.31**2], [1, damping, 37.31**2])
    lag = control.tf([49.6], [1, 49.6])
    pair = control.tf([servo_frequency**2], [1, 2 * 0.167 * servo_frequency, servo_frequency**2])
    gains = control.stability_margins(numerical * experimental * lag * pair, returnall=True)[0]
    return gains.min() / (1.0 + gains.min())


@pytest.fixture(scope="module")
def uncompensated():
    shares = []
    entries = {entry.parameter: entry for entry in sensitivity(UNCOMPENSATED, ONE_MODE, shares.append)}
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    return entries


def test_entries_are_those_of_python_control(uncompensated):
    for name, allowable in (
        ("simulated_table.servo_frequency", lambda f: allowable_by_control(f * 183.6)),
        ("specimen.identified_damping_ratio", lambda f: allowable_by_control(183.6, f * 0.0214)),
    ):
        entry = uncompensated[name]
        for factor, changed in ((0.9, entry.decreased), (1.1, entry.increased)):
            ours = changed.assessment.continuous.margin.allowable_mass_ratio
            assert ours == pytest.approx(allowable(factor), rel=1e-6)
            assert changed.value == pytest.approx(factor * entry.value, rel=1e-12)


def test_parameters_are_those_that_enter_the_loop(uncompensated):
    assert set(uncompensated) == ALWAYS | SERVO | IDENTIFIED


@pytest.fixture(scope="module")
def compensated():
    """With weights of the shaper that may become larger, but not smaller."""
    return by_name(Config().changed(command_shaper__w1=1.05, command_shaper__w2=0.5), AnalysisOptions(modes=1))


def test_parameters_of_compensation_and_estimator_enter_too(compensated):
    others = {"simulated_table.platen_mass", "force_correction.gain"}
    assert set(compensated) == ALWAYS | SERVO | KALMAN | SHAPER | others


def test_coefficients_that_are_0_or_a_leading_1_are_left_out():
    config = Config().changed(
        run__scheme="uc",
        shear_estimator__source="load_cell",
        simulated_table__dynamics="sections",
        simulated_table__sections=[1.0, 1.2, 3051.0, 1.0, 1.1, 2995.0, 0.0, 0.0, 60.0, 0.0, 1.0, 60.0],
        simulated_table__command_delay=0.003,
    )
    names = set(by_name(config))
    assert {name for name in names if "sections" in name} == {
        f"simulated_table.sections[{i}]" for i in (1, 2, 4, 5, 8, 11)
    }
    assert names & SERVO == set()
    assert "simulated_table.command_delay" in names


def test_largest_effect_is_first_and_is_that_of_the_gain_margins(uncompensated):
    effects = [entry.effect for entry in uncompensated.values()]
    assert effects == sorted(effects, reverse=True)
    base = assess(UNCOMPENSATED, ONE_MODE)
    # The share multiplies the loop gain, whatever the loop.
    scale = uncompensated["force_correction.feedback_scale"]
    assert scale.effect == pytest.approx(1.0 / 0.9 - 1.0, rel=1e-9)
    for name, margin in scale.decreased.assessment.gain_margins.items():
        assert margin == pytest.approx(base.gain_margins[name] / 0.9, rel=1e-9)


def test_parameters_of_any_compensator_and_of_the_model_it_knows_enter():
    config = load_config(Path(__file__).parents[2] / "config" / "simplified_bmd.yaml")
    names = set(by_name(config.changed(run__scheme="amb", shear_estimator__source="load_cell")))
    assert {"amb.lower_frequency", "amb.upper_frequency", "identified_model.gain"} <= names
    assert {name.partition(".")[0] for name in names} == {
        *("run", "numerical_substructure", "specimen", "simulated_table", "force_correction"),
        *("amb", "identified_model"),
    }


def test_what_is_not_allowed_says_so(compensated):
    for changed, problem in (
        (compensated["command_shaper.w1"].decreased, "|W1| > 1"),
        (compensated["force_correction.feedback_scale"].increased, "<= 1 is required"),
    ):
        assert changed.assessment is None
        assert problem in changed.problem
        assert not changed.flips_verdict
    assert compensated["command_shaper.w1"].increased.assessment is not None


@pytest.mark.slow
def test_flipped_verdicts_are_marked():
    options = AnalysisOptions(modes=1)
    analyses = assess(UNCOMPENSATED, options).analyses.values()
    close = with_mass_ratio(UNCOMPENSATED, 0.98 * min(a.margin.allowable_mass_ratio for a in analyses))
    assert assess(close, options).go
    entries = by_name(close, options)
    changes = [change for entry in entries.values() for change in (entry.decreased, entry.increased)]
    assert {change.flips_verdict for change in changes} == {True, False}
    for change in changes:
        if change.assessment is not None:
            assert change.flips_verdict == (not change.assessment.go)
