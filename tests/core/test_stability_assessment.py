"""Go or no-go: the three analyses and the verdict they give, the confirmation in the time domain, measured tables."""

import dataclasses
import math

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.loop.closed_loop import ClosedLoop, closed_loop
from bmd_rths_core.stability.analysed_loops import AnalysisOptions, complete_loop, paper_loop, sweep
from bmd_rths_core.stability.assessment import Analysis, Assessment, assess
from bmd_rths_core.stability.confirmation import confirm, free_growth
from bmd_rths_core.stability.continuous import LoopTransferFunction, StabilityMargin, StableInterval
from bmd_rths_core.stability.discrete import discrete_margin, with_mass_ratio
from bmd_rths_core.stability.loop_elements import Delay, MeasuredResponse
from bmd_rths_core.stability.models import experimental_modes, numerical_oscillator, table_sections, uncoupled_modes
from bmd_rths_core.stability.response_file import read_frequency_response
from bmd_rths_core.stability.unit_circle import DiscreteRational, transfer_function
from bmd_rths_core.table.models.dynamics import servo_sections
from tests.conftest import SERVO_TABLE

DEFAULTS = AnalysisOptions()
HEADER = "frequency_hz,magnitude,phase_deg"


def random_config(seed):
    """Return a loop with two stories on each side, a random table and a random scheme."""
    random = np.random.default_rng(seed)
    x = random.random(9)
    return Config().changed(
        run__scheme=("uc", "fc", "plc", "plc_fc")[seed % 4],
        run__time_step=(0.005, 0.002)[seed % 2],
        shear_estimator__source=("kalman", "load_cell")[seed // 2 % 2],
        numerical_substructure__masses=[4000.0, 6000.0],
        numerical_substructure__stiffnesses=[5e7 * (0.1 + x[0]), 5e7 * (0.1 + x[1])],
        numerical_substructure__damping_coefficients=[3e4 * (0.2 + x[2]), 1e4],
        specimen__stiffnesses=[2e6 * (0.2 + x[3]), 5e6 * (0.2 + x[4])],
        simulated_table__servo_real_pole=20.0 + 100.0 * x[5],
        simulated_table__servo_damping_ratio=0.1 + x[6],
        simulated_table__command_delay=0.02 * x[7],
        command_shaper__lead_time=6.0 * x[8] * (0.005, 0.002)[seed % 2],
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_discrete_margin_has_every_interval_that_eigenvalues_over_a_fine_grid_have(seed):
    config = random_config(seed)
    intervals = discrete_margin(config).stable_intervals
    ends = np.array([end for interval in intervals for end in interval[:2] if end > 0.0])
    for ratio in np.concatenate((np.geomspace(1e-4, 0.1, 30), np.linspace(0.1, 0.985, 90))).tolist():
        if np.abs(ratio / ends - 1.0).min(initial=1.0) < 1e-6:
            continue
        stable = any(interval.lower < ratio < interval.upper for interval in intervals)
        assert (closed_loop(with_mass_ratio(config, ratio)).spectral_radius < 1.0) == stable, ratio
    for interval in intervals:
        for end in (interval.lower, interval.upper):
            if 0.0 < end < 0.99:
                radius = closed_loop(with_mass_ratio(config, end)).spectral_radius
                assert radius == pytest.approx(1.0, abs=1e-9)


def test_transfer_function_by_its_roots():
    """A pole that cannot be observed, a lag and a delay, with the transfer function 1 / ((z − 0.9) z)."""
    a = np.array([[0.5, 1.0, 0.0], [0.0, 0.9, 1.0], [0.0, 0.0, 0.0]])
    b, c = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    z = np.exp(1j * np.linspace(0.1, 3.0, 20))
    response = transfer_function(a, b, c, (0.5, 1)).response(z)
    assert response == pytest.approx(1.0 / ((z - 0.9) * z), rel=1e-12)


@pytest.mark.parametrize("double_zero", [1.0, 0.8 + 0.3j])
def test_gain_bound_holds_from_one_on(double_zero):
    """Up to the nearest pole; with a pole and a zero outside the circle and a zero as good as at infinity."""
    zeros = np.array([double_zero, np.conj(double_zero), -0.9, 1.5, -1e9])
    function = DiscreteRational(zeros, np.array([0.9 + 0.1j, 0.9 - 0.1j, 0.2, 1.2, -0.5, 0.0]), 3e-8)
    for theta in np.geomspace(1e-6, 0.14, 30):
        reached = np.abs(function.response(np.exp(1j * np.linspace(0.0, theta, 50)))).max()
        assert reached <= function.gain_bound(theta) * (1.0 + 1e-12)
    assert function.gain_bound(1e-6) == pytest.approx(np.abs(function.response(np.exp(1e-6j))), rel=1e-3)
    assert function.gain_bound(0.15) == np.inf


def test_three_analyses_are_those_of_the_library():
    config = Config().changed(run__scheme="plc", simulated_table__command_delay=0.002, **SERVO_TABLE)
    result = assess(config, AnalysisOptions(feedback_delay_steps=2))
    building = config.numerical_substructure.building().modes()
    by_hand = LoopTransferFunction(
        numerical_oscillator(building.frequencies[0], building.damping_ratios[0]),
        experimental_modes(uncoupled_modes(config.specimen.building())),
        table_sections(servo_sections(49.6, 183.6, 0.167)),
        paper_loop(config, DEFAULTS).compensator,
        0.012,
    ).margin()
    assert result.continuous.margin.allowable_mass_ratio == pytest.approx(by_hand.allowable_mass_ratio, rel=1e-9)
    margin = result.discrete.margin
    assert margin.allowable_mass_ratio == discrete_margin(config).allowable_mass_ratio
    assert result.discrete.spectral_radius == closed_loop(config).spectral_radius


@pytest.mark.parametrize("ratio", [0.25, 0.35, 0.8, 0.995])
def test_stable_means_below_the_margin_and_spectral_radius_below_one(ratio):
    config = with_mass_ratio(Config().changed(run__scheme="plc"), ratio)
    result = assess(config, DEFAULTS)
    assert result.mass_ratio == pytest.approx(ratio, rel=1e-12)
    for analysis in result.analyses.values():
        assert analysis.stable == (ratio < analysis.margin.allowable_mass_ratio)
    assert result.go == all(analysis.stable for analysis in result.analyses.values())


@pytest.mark.parametrize("scheme", ["uc", "plc_fc"])
def test_all_analyses_are_stable_just_below_the_largest_feedback_scale_and_not_above(scheme):
    config = with_mass_ratio(Config().changed(run__scheme=scheme), 0.7)
    largest = assess(config, DEFAULTS).largest_feedback_scale
    assert 0.0 < largest < 1.0
    for factor, go in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        assert assess(config.changed(force_correction__feedback_scale=factor * largest), DEFAULTS).go is go


def made_up(*intervals, mass_ratio=0.5):
    """Return an assessment whose analyses have these stable intervals; the whole mass ratio is 0.5."""
    analyses = []
    for some in intervals:
        margin = StabilityMargin(
            some[0][1], 10.0, tuple(StableInterval(lower, upper, math.nan, 10.0) for lower, upper in some)
        )
        analyses.append(Analysis(margin, any(lower < mass_ratio < upper for lower, upper in some)))
    return Assessment(mass_ratio, 0.5, analyses[0], analyses[1], None, "no reason")


def test_largest_feedback_scale_lies_in_a_stable_interval_of_every_analysis():
    # m_E/m_N is 1 for the whole shear, so that a share is ρ / (1 − ρ).
    conditional = [(0.0, 0.1), (0.2, 0.3)]
    assert made_up(conditional, [(0.0, 0.25)]).largest_feedback_scale == pytest.approx(1.0 / 3.0)
    assert made_up(conditional, [(0.0, 0.15)]).largest_feedback_scale == pytest.approx(1.0 / 9.0)
    assert made_up([(0.0, 0.6)], [(0.0, 0.1), (0.4, 0.7)]).largest_feedback_scale == 1.0
    assert made_up([(0.2, 0.3)], [(0.0, 0.1)]).largest_feedback_scale == 0.0


def test_verdict_in_words():
    go = made_up([(0.0, 0.6)], [(0.0, 0.75)])
    assert go.go
    assert go.verdict_text.startswith("GO: mass ratio 0.500 is below the allowable 0.600 (continuous, 1.59 Hz)")
    assert go.verdict_text.endswith("the shear could be 1.50 times as large")
    no_go = made_up([(0.0, 0.6)], [(0.0, 0.2)])
    assert not no_go.go
    assert no_go.verdict_text == (
        "NO-GO: mass ratio 0.500 is above the allowable 0.200 (continuous_complete, 1.59 Hz); "
        "all analyses are stable up to a feedback scale of 0.2500"
    )
    conditional = made_up([(0.0, 0.2), (0.4, 0.6)], [(0.0, 0.6)])
    assert conditional.go
    assert "conditionally: above the allowable 0.200 (continuous" in conditional.verdict_text


def test_substructure_that_may_yield_is_analysed_about_rest_with_its_own_damping():
    """Modal damping of a single story is that of a dashpot with the same ratio, in all three analyses."""
    story = {"nonlinear__integration": "cr", "nonlinear__story_model": "bilinear", "nonlinear__yield_drifts": [0.01]}
    story |= SERVO_TABLE
    modal = Config().changed(**story, nonlinear__damping="modal", nonlinear__damping_ratios=[0.05])
    dashpot = Config().changed(**story, numerical_substructure__damping_coefficients=[2.0 * 0.05 * 94.09 * 8000.0])
    ours, theirs = assess(modal, DEFAULTS), assess(dashpot, DEFAULTS)
    assert list(ours.analyses) == ["continuous", "continuous_complete", "discrete"]
    for name, analysis in ours.analyses.items():
        ratio = theirs.analyses[name].margin.allowable_mass_ratio
        assert analysis.margin.allowable_mass_ratio == pytest.approx(ratio, rel=1e-6)
        assert ratio > 1.05 * assess(Config().changed(**story), DEFAULTS).analyses[name].margin.allowable_mass_ratio


@pytest.mark.parametrize("modes", [0, 3, -1, "first"])
def test_impossible_modes_are_refused(modes):
    with pytest.raises(InputError, match=r"identified, all or a number from 1 to 2 is required"):
        assess(Config(), AnalysisOptions(modes=modes))


def test_identified_mode_falls_back_to_the_stories():
    config = Config().changed(specimen__identified_frequency=0.0, specimen__identified_damping_ratio=0.0)
    identified, first = (paper_loop(config, AnalysisOptions(modes=modes)).margin() for modes in ("identified", 1))
    assert identified.allowable_mass_ratio == pytest.approx(first.allowable_mass_ratio, rel=1e-12)


def test_sweep_passes_through_the_configured_system():
    config = Config().changed(run__scheme="uc")
    curve = sweep(config, DEFAULTS)
    assert len(curve.frequencies) == 200
    ratio = np.interp(94.09, curve.frequencies, curve.allowable_mass_ratios)
    assert ratio == pytest.approx(assess(config, DEFAULTS).continuous.margin.allowable_mass_ratio, rel=1e-3)


@pytest.mark.parametrize("radius", [0.9995, 1.0, 1.002])
def test_growth_of_a_rotation_is_its_radius(radius):
    turn = radius * np.array([[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]])
    a = np.array([[*turn[0], 5.0], [*turn[1], 0.0], [0.0, 0.0, 0.99]])
    system = DiscreteStateSpace(a, np.array([[0.0], [1.0], [1.0]]), np.eye(3), np.zeros((3, 1)))
    loop = ClosedLoop(system, np.zeros(3), ("x", "y", "z"))
    assert free_growth(loop) == pytest.approx(radius, abs=1e-6)


@pytest.mark.parametrize("scheme", ["uc", "fc", "plc", "plc_fc"])
def test_simulation_confirms_the_discrete_margin(scheme):
    config = Config().changed(run__scheme=scheme)
    margin = discrete_margin(config)
    result = confirm(config, margin)
    assert result.confirmed
    assert not confirm(config, margin._replace(allowable_mass_ratio=0.9 * margin.allowable_mass_ratio)).confirmed
    assert not confirm(config, margin._replace(allowable_mass_ratio=1.1 * margin.allowable_mass_ratio)).confirmed
    for growth, share in ((result.growth_below, 0.99), (result.growth_above, 1.01)):
        radius = closed_loop(with_mass_ratio(config, share * margin.allowable_mass_ratio)).spectral_radius
        assert growth == pytest.approx(radius, abs=1e-5)


def test_without_a_margin_there_is_nothing_to_confirm():
    config = Config().changed(force_correction__gain=1.0)
    assert confirm(config, discrete_margin(config)).confirmed is None
    ended = confirm(Config(), discrete_margin(Config(), largest=0.2))
    assert ended.confirmed is True
    assert np.isnan(ended.growth_above)


def test_measured_table_replaces_table_and_delay(tmp_path):
    """A pure delay written as data gives what the delay gives."""
    hertz = np.linspace(0.01, 80.0, 8000)
    rows = (f"{-360.0 * f * 0.02:.12g},1.0,{f:.12g}" for f in hertz)
    path = tmp_path / "table.csv"
    path.write_text("# measured\nphase_deg,magnitude,frequency_hz\n" + "\n".join(rows) + "\n")
    config = Config().changed(run__scheme="uc", simulated_table__command_delay=0.05)
    options = AnalysisOptions(measured_table=read_frequency_response(path), not_fitted="too few frequencies")
    measured = assess(config, options)
    known = dataclasses.replace(paper_loop(config, DEFAULTS), table=Delay(0.02), feedback_delay=0.0).margin()
    assert measured.continuous.margin.allowable_mass_ratio == pytest.approx(known.allowable_mass_ratio, rel=1e-9)
    late = dataclasses.replace(complete_loop(config, DEFAULTS), table=Delay(0.02), feedback_delay=0.005).margin()
    assert measured.continuous_complete.margin.allowable_mass_ratio == pytest.approx(
        late.allowable_mass_ratio, rel=1e-9
    )
    assert measured.discrete is None
    assert measured.discrete_reason.endswith("of the table has no fit: too few frequencies")


@pytest.mark.parametrize(("highest", "go"), [(18.0, False), (25.0, True)])
def test_measurement_that_does_not_cover_the_modes_is_no_go(highest, go):
    """The second mode of the specimen is at 19.2 Hz."""
    omega = np.linspace(0.1, 2.0 * np.pi * highest, 1000)
    options = AnalysisOptions(measured_table=MeasuredResponse(omega, np.exp(-0.001j * omega)))
    result = assess(with_mass_ratio(Config().changed(run__scheme="uc"), 0.01), options)
    assert result.continuous.stable
    assert result.go == go
    assert ("measured up to 18 Hz, but the substructures have modes up to 19.21 Hz" in result.verdict_text) != go


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "the file is empty"),
        (f"{HEADER}\n1,1,0\n", "2 rows"),
        ("frequency_hz,phase_deg\n1,1\n2,1\n", "line 1: 0 columns magnitude"),
        (f"{HEADER},magnitude\n1,1,0,1\n2,1,0,1\n", "line 1: 2 columns magnitude"),
        (f"{HEADER}\n1,1,0\n2,1\n", "line 3: 2 cells"),
        (f"{HEADER}\n1,1,0\n2,one,0\n", "line 3: 'one' is not a finite number"),
        (f"{HEADER}\n1,1,0\n2,nan,0\n", "line 3: 'nan' is not a finite number"),
        (f"{HEADER}\n0,1,0\n2,1,0\n", "line 2: frequency_hz 0 is not allowed; > 0 Hz"),
        (f"{HEADER}\n1,1,0\n\n1,1,0\n", "line 4: frequency_hz 1 is not allowed; > 1 Hz"),
        (f"{HEADER}\n1,1,0\n2,0,0\n", "line 3: magnitude 0 is not allowed"),
    ],
)
def test_what_is_no_frequency_response_is_refused_in_one_line(tmp_path, text, problem):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_frequency_response(path)
    assert problem in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
