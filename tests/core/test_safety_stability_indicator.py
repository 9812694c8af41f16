"""The stability indicator: closed forms of growth, silence in stable runs, early trips in unstable ones."""

from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.ground_motion.config import GroundMotionConfig, select_ground_motion
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.safety import Action, SafetyConfig, StabilityIndicator, StabilityIndicatorArray
from bmd_rths_core.stability.discrete import discrete_margin, with_mass_ratio
from tests.conftest import ground_motion_folder

EIGHT_STORY = load_config(Path(__file__).parents[2] / "config" / "eight_story_bmd.yaml")
EL_CENTRO = select_ground_motion(Config().ground_motion, 0.005)

MASS, DAMPING, STIFFNESS = 100.0, 40.0, 9e4  # 30 rad/s
DT = 0.001


def indicator(**changes):
    return StabilityIndicator(SafetyConfig(**changes), (MASS,), np.array([[DAMPING]]), DT)


def values(displacement, force):
    """Return the indicator at every step of a single floor, and the trips."""
    found = indicator()
    trips, history = [], []
    for step, (u, f) in enumerate(zip(displacement, force, strict=True)):
        trips.append(found.step(step, f, np.array([u])))
        history.append(found.value)
    return np.array(history), [trip for trip in trips if trip is not None]


def vibration(growth, amplitude, seconds):
    """Return displacement e^(σt) sin(ωt) and the force that drives it, from the equation of motion."""
    time = DT * np.arange(round(seconds / DT))
    pole = growth + 30.0j
    u = amplitude * np.exp(pole * time)
    return u.imag, ((MASS * pole**2 + DAMPING * pole + STIFFNESS) * u).imag


@pytest.mark.parametrize("growth", [0.3, 1.0, 3.0])
def test_growing_vibration_raises_it_by_twice_the_growth_rate(growth):
    """Energy grows with e^(2σt); the amplitude is large against the floor, and the start from rest is forgotten."""
    history, trips = values(*vibration(growth, 1.0, 4.0))
    forgotten = slice(2500, 4000)
    rate = np.polyfit(DT * np.arange(4000)[forgotten], history[forgotten], 1)[0]
    assert rate == pytest.approx(2.0 * growth, rel=0.01)
    assert len(trips) == 1


@pytest.mark.parametrize("growth", [-0.3, -3.0])
def test_decaying_vibration_lowers_it_to_zero(growth):
    history, _ = values(*vibration(growth, 1.0, 4.0))
    assert history[-1] < 0.02


def test_vibration_with_constant_amplitude_leaves_it():
    """The interface feeds in what damping takes away: marginal."""
    history, _ = values(*vibration(0.0, 1.0, 10.0))
    assert abs(history[-1] - history[1000]) < 0.05


def test_vibration_far_below_the_floor_hardly_counts():
    """Jerk is 30³ times the amplitude; the floor is 60 m/s³."""
    history, trips = values(*vibration(0.3, 1e-5, 5.0))
    assert trips == []
    assert history.max() < 0.05


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0, 3.0])
def test_floor_attenuates_growth_by_the_share_of_the_energy(share):
    """Growth counts r² / (1 + r²) at r times the floor, so that its integral is ln (1 + r²), whose r grows with σ."""
    growth, middle = 0.3, 2.0
    amplitude = share * SafetyConfig().stability_floor * np.sqrt(2.0) / 30.0**3 * np.exp(-growth * middle)
    history, _ = values(*vibration(growth, amplitude, 3.0))
    first, last = np.log(1.0 + (share * np.exp(growth * np.array([1.0, 3.0]) - growth * middle)) ** 2)
    assert history[2999] - history[1000] == pytest.approx(last - first, rel=0.1)


def test_first_passage_is_told_once_until_reset():
    displacement, force = vibration(3.0, 1.0, 0.6)
    found = indicator(stability_action="hold")
    for _ in range(2):
        found.reset()
        trips = [found.step(k, f, np.array([u])) for k, (u, f) in enumerate(zip(displacement, force, strict=True))]
        (trip,) = [trip for trip in trips if trip is not None]
        assert (trip.limit, trip.action, trip.allowed) == ("safety.stability_limit", Action.HOLD, 0.7)
        assert trip.value > 0.7
        assert trips[trip.step] is trip


def test_ignored_indicator_does_nothing():
    found = indicator(stability_action="ignore")
    assert all(found.step(k, 1e9 * k**3, np.array([1.0 * k**4])) is None for k in range(100))
    assert found.value == 0.0


def test_several_floors_give_the_power_of_all_dampers():
    """One step against numpy: third differences, mean second difference of the force, u̇ᵀ C u̇ and u̇ᵀ M u̇."""
    random = np.random.default_rng(5)
    masses, damping = np.array([2.0, 3.0]), np.array([[5.0, -2.0], [-2.0, 2.0]])
    config = SafetyConfig(stability_time=DT, stability_floor=1e-9)
    found = StabilityIndicator(config, masses, damping, DT)
    u, f = random.standard_normal((4, 2)), 1e9 * random.standard_normal(4)
    before = 0.0
    for k in range(4):
        before = found.value
        found.step(k, f[k], u[k])
    jerk = np.diff(u, 3, axis=0)[0] / DT**3
    power = np.diff(f, 2).mean() / DT**2 * jerk[1] - jerk @ damping @ jerk
    assert found.value == pytest.approx(max(0.0, before + DT * power / (masses @ jerk**2)), rel=1e-9)


def largest_value(config, motion):
    """Return the record of a run that the indicator does not stop, and its largest value."""
    loop = RthsLoop(config.changed(safety__stability_limit=1e9), motion)
    return loop.run(), loop.stability_indicator.largest


RECORDS = ("Christchurch/RSN8123_CCHURCH_REHSN02E.AT2", "Northridge/RSN1044_NORTHR_NWH090.AT2")


@pytest.mark.parametrize("scheme", SCHEME_NAMES)
@pytest.mark.parametrize("record", ["el_centro_1940_ns", *RECORDS])
def test_stable_runs_stay_far_below_the_limit(record, scheme):
    path = record if record == "el_centro_1940_ns" else ground_motion_folder() / record
    if isinstance(path, Path) and not path.exists():
        pytest.skip("the real records are not there")
    config = Config().changed(run__scheme=scheme)
    motion = select_ground_motion(GroundMotionConfig(str(path), duration=20.0), 0.005)
    run, value = largest_value(config, motion)
    assert run.outcome == "finished"
    assert value < 0.2 * config.safety.stability_limit


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEME_NAMES)
def test_run_near_its_margin_is_not_stopped(scheme):
    config = Config().changed(run__scheme=scheme)
    config = with_mass_ratio(config, 0.95 * discrete_margin(config).allowable_mass_ratio)
    assert closed_loop(config).spectral_radius < 1.0
    assert RthsLoop(config, EL_CENTRO).run().outcome == "finished"


@pytest.mark.parametrize("factor", [1.2, *(pytest.param(f, marks=pytest.mark.slow) for f in (1.05, 1.5, 2.0))])
@pytest.mark.parametrize("scheme", SCHEME_NAMES)
def test_diverging_run_is_stopped_long_before_the_acceleration_limit(scheme, factor):
    config = Config().changed(run__scheme=scheme, safety__tracking_action="ignore")
    config = with_mass_ratio(config, factor * discrete_margin(config).allowable_mass_ratio)
    assert closed_loop(config).spectral_radius > 1.0
    run = RthsLoop(config, EL_CENTRO).run()
    assert "safety.stability_limit" in run.reason
    assert np.abs(run.command).max() < 0.7 * config.safety.acceleration_limit
    assert np.isfinite(run.table_acceleration).all()  # the command of the step that trips is not even made
    limited, _ = largest_value(config, EL_CENTRO)
    assert run.steps < limited.steps


def test_other_mode_of_the_8_story_system_is_found_too():
    config = EIGHT_STORY.changed(run__scheme="plc")
    run = RthsLoop(config, EL_CENTRO).run()
    assert "safety.stability_limit" in run.reason


def test_array_form_equals_the_indicator_of_every_run():
    """In chunks of unequal length, and with a run that is left out on the way; growing, marginal and decaying ones."""
    masses, damping = (100.0, 60.0), np.array([[40.0, -15.0], [-15.0, 25.0]])
    random = np.random.default_rng(1)
    time = DT * np.arange(900)
    growth = np.array([3.0, 0.0, -2.0])[:, None]
    side = np.array([1.0, 1.0, -1.0])[:, None]  # of the last run the interface takes energy out
    forces = 1e4 * side * np.exp(growth * time) * np.sin(30.0 * time + 1.2) + random.standard_normal((3, 900))
    floors = 0.1 * np.exp(growth * time) * np.sin(30.0 * time)
    displacements = np.stack((0.6 * floors, floors), axis=1) + 1e-6 * random.standard_normal((3, 2, 900))
    expected = np.zeros((3, 900))
    for run in range(3):
        scalar = StabilityIndicator(SafetyConfig(), masses, damping, DT)
        for step in range(900):
            acting = forces[run, step - 1] if step else 0.0  # the shear fed back acts at the step after
            scalar.step(step, acting, displacements[run, :, step])
            expected[run, step] = scalar.value
    array = StabilityIndicatorArray(SafetyConfig(), masses, damping, DT, 3)
    kept, found = np.array([True, False, True]), np.full((3, 900), np.nan)
    for runs, begin, end in (([0, 1, 2], 0, 1), ([0, 1, 2], 1, 300), ([0, 2], 300, 302), ([0, 2], 302, 900)):
        if begin == 300:
            array.keep(kept)
        found[runs, begin:end] = array.advance(forces[runs, begin:end], displacements[runs, :, begin:end])
    assert expected.max() > 0.5
    assert (expected[:, 1:] == 0.0).any()
    np.testing.assert_allclose(found[kept], expected[kept], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[1, :300], expected[1, :300], rtol=1e-9, atol=1e-9)
