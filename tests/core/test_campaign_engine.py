"""The campaign engine equals `RthsLoop`: every signal, the outcome, the step it ends at and the reason."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bmd_rths_core.campaign.engine import SelectedMotion, run_motions
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import GroundMotionConfig
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.discrete import discrete_margin, with_mass_ratio
from bmd_rths_core.stability.models import EQUATION_9
from tests.conftest import WITHOUT_LIMITS, examples
from tests.core.mpic_parts import exact

DT = 0.005
TABLES = {
    "servo": {},
    "fractional delay": {"simulated_table__command_delay": 0.0075},
    "perfect, delayed": {"simulated_table__dynamics": "perfect", "simulated_table__command_delay": 0.012},
    "Eq. 9": {"simulated_table__dynamics": "sections", "simulated_table__sections": list(EQUATION_9)},
}
THREE_STORIES = {
    "numerical_substructure__masses": [9000.0, 7000.0, 6000.0],
    "numerical_substructure__stiffnesses": [9e7, 8e7, 6e7],
    "numerical_substructure__damping_coefficients": [9e4, 6e4, 4e4],
}


def selected(steps, name="motion", frequency=3.0, peak=1.0):
    """Return a motion that does not begin at zero."""
    time = np.arange(steps) * DT
    acceleration = peak * np.cos(2 * np.pi * frequency * time) * np.exp(-0.5 * time)
    return SelectedMotion(GroundMotionConfig(record=name), GroundMotion(name, DT, acceleration, "test", "0" * 64))


def assert_equal_to_the_loop(config, motions, engine="linear"):
    """Compare every run; one that a limit ends has to be the loop's own, one that none ends that of `engine`."""
    records = []
    for run, motion in zip(run_motions(config, motions), motions, strict=True):
        expected = RthsLoop(config, motion.motion).run()
        record = run.record
        assert run.engine in (("stages",) if expected.outcome == "limit" else engine.split(" or "))
        assert (record.outcome, record.reason, record.steps) == (expected.outcome, expected.reason, expected.steps)
        assert record.motion == expected.motion
        assert record.configuration["ground_motion"]["record"] == motion.selection.record
        for name, theirs in expected.signals().items():
            ours = record.signals()[name]
            assert ours.shape == theirs.shape
            assert np.array_equal(np.isnan(ours), np.isnan(theirs)), name
            if theirs.size and not np.isnan(theirs).all():
                assert np.nanmax(np.abs(ours - theirs)) <= 1e-10 * np.nanmax(np.abs(theirs)) + 1e-12, name
        records.append(record)
    return records


@pytest.mark.parametrize("source", ["kalman", "load_cell"])
@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("scheme", ["uc", "fc", "plc", "plc_fc"])
def test_runs_equal_those_of_the_loop(scheme, table, source):
    config = Config().changed(run__scheme=scheme, shear_estimator__source=source, **TABLES[table])
    assert_equal_to_the_loop(config, [selected(350), selected(150, "shorter", 7.0), selected(2, "shortest")])


@pytest.mark.parametrize(
    "changes",
    [
        {"run__seed": 7},
        {"force_correction__feedback_scale": 0.3},
        {"run__time_step": 0.0025},
        {"simulated_table__specimen_stiffness_factor": 1.1},
        {"simulated_table__platen_mass": 100.0, "simulated_table__shear_noise": 500.0},
        THREE_STORIES,
        WITHOUT_LIMITS,
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_other_configurations_equal_those_of_the_loop(changes):
    assert_equal_to_the_loop(Config().changed(**changes), [selected(500)])


@pytest.mark.slow
def test_long_runs_equal_those_of_the_loop():
    """Longer than the chunks that the engine works in; one run ends in the middle of a chunk, one before it."""
    assert_equal_to_the_loop(Config(), [selected(5000, frequency=0.7), selected(2048, "short"), selected(2049, "one")])


#: A limit that the run of `selected` passes.
PASSED = {
    "displacement": 0.006,
    "velocity": 0.05,
    "acceleration": 1.5,
    "increment": 1.0,
    "force": 2500.0,
    "tracking": 0.5,
    "stability": 0.4,
}


@pytest.mark.parametrize(
    "action",
    ["ramp", *(pytest.param(a, marks=pytest.mark.slow) for a in ("hold", "emergency_stop", "indicate", "ignore"))],
)
@pytest.mark.parametrize("limit", PASSED)
def test_limits_end_a_run_as_they_end_that_of_the_loop(limit, action):
    changes = {f"safety__{limit}_limit": PASSED[limit], f"safety__{limit}_action": action}
    if limit == "stability":
        changes["safety__stability_floor"] = 1.0
    if limit == "velocity":  # the way to rest keeps it
        changes["safety__ramp_velocity"] = PASSED[limit]
    steps = 900 if limit == "stability" else 450  # the window of the indicator has to fill
    (record, _) = assert_equal_to_the_loop(Config().changed(**changes), [selected(steps), selected(200, peak=1e-3)])
    assert record.stable == (action in ("indicate", "ignore"))
    assert record.stable or f"safety.{limit}_limit" in record.reason


@pytest.mark.slow
def test_limit_that_is_passed_late_ends_the_run():
    """The bounds remember what was before the chunk."""
    time = np.arange(5500) * DT
    rising = GroundMotion("rising", DT, 0.035 * time * np.sin(2 * np.pi * 1.5 * time), "test", "0" * 64)
    motions = [SelectedMotion(GroundMotionConfig(record="rising"), rising)]
    for limit, value in (("displacement", 0.007), ("tracking", 0.16), ("increment", 0.68), ("velocity", 0.06)):
        changes = {f"safety__{limit}_limit": value, "safety__ramp_velocity": 0.06}
        (record,) = assert_equal_to_the_loop(Config().changed(**changes), motions)
        assert f"safety.{limit}_limit" in record.reason
        assert 2048 < record.steps < 5500


@pytest.mark.parametrize(("share", "after"), [(1.02, 2048), (1.3, 0)])
def test_diverging_run_is_ended_by_the_stability_indicator(share, after):
    config = Config().changed(run__scheme="uc", safety__acceleration_action="ignore")
    config = with_mass_ratio(config, share * discrete_margin(config).allowable_mass_ratio)
    (record,) = assert_equal_to_the_loop(config, [selected(12000)])
    assert "safety.stability_limit" in record.reason
    assert record.steps > after


@pytest.mark.slow
def test_run_without_limits_that_overflows_is_left_to_the_loop():
    config = Config().changed(run__scheme="uc", **WITHOUT_LIMITS)
    config = with_mass_ratio(config, 0.9)
    with np.errstate(all="ignore"):
        (record,) = assert_equal_to_the_loop(config, [selected(12000)], engine="stages")
    assert "safety.non_finite_action" in record.reason


@pytest.mark.parametrize(
    "changes",
    [
        {"simulated_table__acceleration_resolution": 0.01},
        {"nonlinear__integration": "cr", "nonlinear__story_model": "bilinear", "nonlinear__yield_drifts": [1e-4]},
    ],
    ids=["quantisation", "yielding"],
)
def test_what_is_not_linear_is_run_by_the_loop(changes):
    assert_equal_to_the_loop(Config().changed(**changes), [selected(300)], engine="stages")


@pytest.mark.parametrize(("displacement", "steps"), [(0.02, 285), (0.03, 335), (0.04, 395)])
def test_braking_that_the_acceleration_limit_slows_is_foreseen(displacement, steps):
    """A limit below `ramp_acceleration` makes the way to rest longer than that parameter says."""
    time = np.arange(steps) * DT
    rising = GroundMotion("rising", DT, 0.045 * time * np.sin(2 * np.pi * 0.3 * time), "test", "0" * 64)
    limits = {"safety__acceleration_limit": 0.5, "safety__ramp_acceleration": 20.0}
    config = Config().changed(safety__displacement_limit=displacement, **limits)
    (record,) = assert_equal_to_the_loop(config, [SelectedMotion(GroundMotionConfig(record="rising"), rising)])
    assert "safety.displacement_limit" in record.reason


@pytest.mark.parametrize(("limit", "allowed"), [("force", 1e4), ("tracking", 0.9)])
@pytest.mark.parametrize("config", [Config(), exact()], ids=["shaper", "control"])
def test_limit_that_is_passed_on_the_way_to_rest_is_told(config, limit, allowed):
    """The way is steeper than the test. Runs that end sooner and later have ways of their own."""
    ramp = {"safety__ramp_acceleration": 5.0, "safety__ramp_jerk": 500.0, f"safety__{limit}_limit": allowed}
    motions = [selected(steps, frequency=1.0, peak=peak) for steps, peak in ((400, 0.3), (400, 1e-3), (300, 0.2))]
    steep, *_ = assert_equal_to_the_loop(config.changed(**ramp), motions, engine="linear or stages")
    assert steep.outcome == "finished"
    assert f"on the way to rest: safety.{limit}_limit" in steep.reason


@pytest.mark.slow
@settings(max_examples=examples(25), deadline=None)
@example(scheme="uc", frequency=1.0, peak=0.023, strictness=0.0215, ramp_acceleration=1.0, ramp_jerk=50.0)
@given(
    scheme=st.sampled_from(["uc", "fc", "plc", "plc_fc"]),
    frequency=st.floats(0.3, 20.0),
    peak=st.floats(0.01, 10.0),
    strictness=st.floats(0.02, 1.0),
    ramp_acceleration=st.floats(1.0, 20.0),
    ramp_jerk=st.floats(50.0, 2000.0),
)
def test_no_limit_that_the_supervisor_sees_is_missed(scheme, frequency, peak, strictness, ramp_acceleration, ramp_jerk):
    limits = {"displacement": 0.23, "velocity": 1.0, "acceleration": 20.0, "increment": 15.0, "tracking": 5.0}
    changes = {f"safety__{name}_limit": strictness * value for name, value in limits.items()}
    ramp = {"safety__ramp_acceleration": min(ramp_acceleration, strictness * limits["acceleration"])}
    ramp |= {"safety__ramp_jerk": ramp_jerk, "safety__ramp_velocity": min(0.2, strictness * limits["velocity"])}
    config = Config().changed(run__scheme=scheme, **changes, **ramp)
    assert_equal_to_the_loop(config, [selected(400, frequency=frequency, peak=peak)], engine="linear or stages")
