"""What the figures show, as numbers: those of the paper's text, closed forms, and the curves between their points."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from bmd_rths_core.analysis.metrics import run_metrics
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.paper_figures.margins import TOLERANCE, figure_7, figure_8, figure_11, resolved_curve
from bmd_rths_core.paper_figures.systems import EIGHT_STORY, SIMPLIFIED, system_of, table_name
from bmd_rths_core.paper_figures.table_response import equivalent_delay, figure_6, figure_10
from bmd_rths_core.paper_figures.time_history import figure_13, strong_motion
from bmd_rths_core.stability.continuous import MarginCurve, margin_curve
from bmd_rths_core.stability.models import EQUATION_9, experimental_modes, table_sections, uncoupled_modes
from tests.conftest import SERVO_TABLE, ground_motion_folder

CONFIGS = Path(__file__).parents[2] / "config"
OF_EIGHT_STORY = load_config(CONFIGS / "eight_story_bmd.yaml")
OF_SIMPLIFIED = load_config(CONFIGS / "simplified_bmd.yaml")
PARKFIELD = ground_motion_folder() / "Parkfield" / "RSN30_PARKF_C05085.AT2"


def hertz(frequency):
    return 2.0 * np.pi * frequency


@pytest.mark.parametrize(
    ("figure", "config", "one_mode", "all_modes", "marks"),
    [
        (figure_7, OF_EIGHT_STORY, [0.1456, 0.4729], [0.1430, 0.2369], [0.65, 0.15, 0.2]),
        (figure_8, OF_EIGHT_STORY, [0.7389], [0.4849], [0.65]),
        (figure_11, OF_SIMPLIFIED, [0.1777, 0.2359], [0.2090, 0.2685], [0.161, 0.2]),
    ],
    ids=["Figure 7", "Figure 8", "Figure 11"],
)
def test_margins_at_the_frequency_of_the_system(figure, config, one_mode, all_modes, marks):
    data = figure(config)
    assert [mark.mass_ratio for mark in data.marks] == pytest.approx(marks, abs=5e-5)
    for panel, expected in zip(data.panels, (one_mode, all_modes), strict=True):
        for labelled, ratio in zip(panel.curves, expected, strict=False):
            assert round(labelled.at_system, 4) == ratio
            curve = labelled.curve
            drawn = np.interp(data.system.frequency, curve.frequencies, curve.allowable_mass_ratios)
            assert drawn == pytest.approx(ratio, abs=2 * TOLERANCE)


def test_curve_is_right_between_its_points_and_in_its_valleys():
    experimental = experimental_modes(uncoupled_modes(OF_EIGHT_STORY.specimen.building()))

    def exact(omega):
        return margin_curve(omega, 0.02, experimental, table_sections(EQUATION_9))

    def ratio(omega):
        return exact(np.array([omega])).allowable_mass_ratios[0]

    curve = resolved_curve(100.0, exact)
    omega = np.random.default_rng(1).uniform(1.0, 100.0, 500)
    drawn = np.interp(omega, curve.frequencies, curve.allowable_mass_ratios)
    assert np.abs(drawn - exact(omega).allowable_mass_ratios).max() < 2 * TOLERANCE
    for lower, upper in ((15.0, 22.0), (56.0, 62.0), (95.0, 100.0)):
        valley = minimize_scalar(ratio, bounds=(lower, upper), method="bounded")
        inside = (curve.frequencies >= lower) & (curve.frequencies <= upper)
        assert curve.allowable_mass_ratios[inside].min() == pytest.approx(valley.fun, abs=TOLERANCE)


def test_points_gather_at_a_valley_and_a_jump():
    def curve(omega):
        ratio = np.where(omega < 7.123, 0.5 - 0.4 / (1.0 + ((omega - 3.0) / 0.05) ** 2), 0.2)
        return MarginCurve(omega, ratio, np.full_like(omega, np.nan))

    points = resolved_curve(10.0, curve)
    assert (np.diff(points.frequencies) > 0.0).all()
    omega = np.setdiff1d(np.linspace(0.1, 10.0, 9001), np.linspace(7.12, 7.126, 7))
    drawn = np.interp(omega, points.frequencies, points.allowable_mass_ratios)
    away = np.abs(omega - 7.123) > 0.002
    assert np.abs(drawn - curve(omega).allowable_mass_ratios)[away].max() < 2 * TOLERANCE
    before = points.frequencies < 7.123
    assert points.frequencies[~before][0] - points.frequencies[before][-1] < 0.002


def test_system_is_known_by_its_frequency():
    assert system_of(OF_EIGHT_STORY) is EIGHT_STORY
    assert system_of(OF_SIMPLIFIED) is SIMPLIFIED
    stiffer = OF_SIMPLIFIED.changed(numerical_substructure__stiffnesses=[4.0 * 8000.0 * 94.09**2])
    with pytest.raises(InputError, match=r"188\.2 rad/s .* 35\.43 rad/s .* 94\.09 rad/s"):
        system_of(stiffer)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({}, "third-order servo with interaction"),
        ({"dynamics": "servo"}, "third-order servo"),
        ({"dynamics": "perfect", "command_delay": 0.025}, "perfect table + 25 ms"),
        ({"dynamics": "sections", "sections": EQUATION_9}, "Eq. 9"),
        ({"dynamics": "sections", "sections": EQUATION_9[:6]}, "configured sections"),
    ],
)
def test_name_of_the_table(changes, name):
    assert table_name(Config().changed(**{f"simulated_table__{key}": value for key, value in changes.items()})) == name


def test_delay_of_a_pure_delay_is_that_delay():
    omega = np.linspace(0.1, hertz(20.0), 500)
    assert equivalent_delay(omega, 0.7 * np.exp(-0.026j * omega)) == pytest.approx(0.026, rel=1e-12)


@pytest.mark.slow
def test_figure_6_is_equation_9_and_the_measurement_finds_it():
    data = figure_6(OF_EIGHT_STORY)
    s = 1j * data.frequencies
    exact = 1.1768e10 * (s**2 + 1.186 * s + 3051) * (s**2 + 4.739 * s + 1.06e4) / (s + 64.95)
    exact /= (s**2 + 1.108 * s + 2995) * (s**2 + 97.46 * s + 8960)
    exact /= (s**2 + 4.567 * s + 1.049e4) * (s**2 + 21.07 * s + 2.13e4)
    assert data.model == pytest.approx(exact, rel=1e-12)
    of_model, as_measured, natural_frequency = (comparison.value for comparison in data.comparisons)
    assert 27.0 <= of_model <= 27.3
    assert as_measured == pytest.approx(of_model, abs=0.1)
    assert natural_frequency == pytest.approx(np.sqrt(2995.0) / hertz(1.0))
    assert (data.delay, data.interaction) == (0.026, hertz(8.98))
    assert data.measured.frequencies[-1] == pytest.approx(hertz(20.0), rel=0.01)
    assert_measured(data, table_sections(EQUATION_9))


@pytest.mark.slow
def test_figure_10_is_the_configured_servo_and_the_measurement_finds_it():
    seen = []
    data = figure_10(OF_SIMPLIFIED.changed(**SERVO_TABLE), seen.append)
    assert_progress(seen)
    s = 1j * data.frequencies
    assert data.model == pytest.approx(49.6 / (s + 49.6) * 183.6**2 / (s**2 + 2 * 0.167 * 183.6 * s + 183.6**2))
    assert (data.delay, data.interaction) == (0.025, None)
    assert_measured(data, table_sections((0, 0, 49.6, 0, 1, 49.6, 0, 0, 183.6**2, 1, 2 * 0.167 * 183.6, 183.6**2)))


def assert_measured(data, table):
    """Single frequencies scatter; most where a resonance is hardly wider than the resolution of 0.05 Hz."""
    ratio = data.measured.response / table.response(data.measured.frequencies)
    magnitude, phase = np.abs(ratio) - 1.0, np.degrees(np.angle(ratio))
    assert np.sqrt(np.mean(magnitude**2)) < 0.015
    assert np.sqrt(np.mean(phase**2)) < 1.0
    assert np.abs(magnitude).max() < 0.15
    assert np.abs(phase).max() < 8.0
    assert 0.9 < data.measured.coherence.min() < data.measured.coherence.max() <= 1.0


@pytest.mark.slow
def test_figure_6_has_the_pure_delay_of_the_command():
    delayed = OF_EIGHT_STORY.changed(simulated_table__command_delay=0.0075)
    delay, as_measured, _ = (comparison.value for comparison in figure_6(delayed).comparisons)
    assert delay == pytest.approx(27.06 + 7.5, abs=0.01)
    assert as_measured == pytest.approx(delay, abs=0.1)


@pytest.mark.slow
def test_figure_13_is_the_run_with_both_compensations():
    seen = []
    data = figure_13(OF_SIMPLIFIED.changed(run__scheme="uc"), seen.append)
    assert_progress(seen)
    config = OF_SIMPLIFIED.changed(run__scheme="plc_fc")
    record = RthsLoop(config, select_ground_motion(config.ground_motion, 0.005)).run()
    assert data.rmse_percent == run_metrics(record).rmse_percent["superstructure"]
    assert np.array_equal(data.rths, record.floor_accelerations[:-1, 1])
    assert data.time == pytest.approx(0.005 * np.arange(1, record.steps))
    assert (data.motion, data.is_parkfield, data.stopped) == ("el_centro_1940_ns", False, "")
    assert data.comparisons[0].paper == "not this ground motion"


def test_figure_13_of_the_paper():
    if not PARKFIELD.is_file():
        pytest.skip("no real records here")
    data = figure_13(OF_SIMPLIFIED.changed(ground_motion__record=str(PARKFIELD)))
    assert data.is_parkfield
    assert data.comparisons[0].paper == "48.84 %, Table 3"
    assert np.abs(data.rths).max() > np.abs(data.benchmark).max()  # "slightly larger than the benchmark response"


def test_a_test_that_passes_a_limit_is_told():
    data = figure_13(OF_SIMPLIFIED.changed(safety__acceleration_limit=1.0, safety__ramp_acceleration=1.0))
    assert "safety.acceleration_limit" in data.stopped
    assert len(data.time) == len(data.rths) == len(data.benchmark)


@pytest.mark.parametrize("figure", [figure_10, figure_13])
def test_a_limit_that_lets_nothing_through_is_one_line(figure):
    with pytest.raises(InputError, match=r"safety\.acceleration_limit \[m/s2\] passed at step"):
        figure(OF_SIMPLIFIED.changed(safety__acceleration_limit=1e-9))


def test_strong_motion_is_where_the_energy_is():
    time = 0.01 * np.arange(1, 3001)
    burst = np.where((time > 12.0) & (time <= 17.0), 1.0, 0.1) * np.sin(40.0 * time)
    assert strong_motion(burst, 0.01) == pytest.approx((12.0, 17.0), abs=0.1)
    assert strong_motion(burst[:200], 0.01) == pytest.approx((0.01, 2.0))


def assert_progress(seen):
    assert seen == sorted(seen)
    assert 0.0 <= seen[0] < 0.1
    assert 0.9 < seen[-1] <= 1.0
