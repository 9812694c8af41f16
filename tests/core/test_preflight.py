"""Pre-flight: it predicts what the loop then does, and refuses what must not be run, naming the limit."""

from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.analysis.preflight import predict_test
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.rths_loop import RthsLoop
from tests.conftest import WITHOUT_LIMITS

EIGHT_STORY = Path(__file__).parents[2] / "config" / "eight_story_bmd.yaml"
DT = 0.005

#: A table that follows every command and sensors without noise, so that the motion is that of the ground.
QUIET = Config().changed(
    simulated_table__dynamics="perfect",
    simulated_table__acceleration_noise=0.0,
    simulated_table__shear_noise=0.0,
    simulated_table__displacement_noise=0.0,
    simulated_table__force_noise=0.0,
    run__scheme="uc",
)


def el_centro(config, **changes):
    config = config.changed(**changes)
    return config, select_ground_motion(config.ground_motion, DT)


def moved_ground(*positions):
    """Return a ground that moves smoothly from one position to the next in 1 s, and rests there for 1 s."""
    move = 2.0 * np.pi * np.sin(2.0 * np.pi * DT * np.arange(200))  # of the way t - sin(2 π t) / 2 π
    parts = [np.concatenate((way * move, np.zeros(200))) for way in np.diff((0.0, *positions))]
    return GroundMotion("moved", DT, np.concatenate(parts), "test", "0" * 64)


def test_peaks_are_those_of_the_run_that_follows():
    config, motion = el_centro(Config(), ground_motion__duration=8.0, run__seed=7)
    preflight = predict_test(config, motion)
    record = RthsLoop(config, motion).run()
    assert preflight.cleared
    assert preflight.verdict.startswith("GO:")
    assert preflight.peaks.displacement == np.abs(record.table_displacement).max()
    assert preflight.peaks.force == np.abs(record.actuator_force).max()
    assert preflight.peaks.acceleration == np.abs(record.command).max()
    assert 0.0 < preflight.peaks.stability_indicator < 0.1


def test_motion_of_a_perfect_table_is_that_of_the_ground():
    """The building is stiff: the interface moves with the ground, by 50 mm, at 2 · 0.05 m/s at most."""
    preflight = predict_test(QUIET, moved_ground(0.05, 0.0))
    assert preflight.cleared
    assert preflight.peaks.displacement == pytest.approx(0.05, rel=0.01)
    assert preflight.peaks.velocity == pytest.approx(0.1, rel=0.02)
    assert preflight.peaks.acceleration == pytest.approx(2.0 * np.pi * 0.05, rel=0.1)


def test_other_controllers_are_predicted_with_the_simulated_table():
    config, motion = el_centro(Config(), ground_motion__duration=1.0)
    assert predict_test(config.changed(table__controller="udp"), motion) == predict_test(config, motion)


def test_no_go_is_a_problem_and_so_is_the_limit_that_the_prediction_passes():
    config, motion = el_centro(load_config(EIGHT_STORY))
    verdict, limit = predict_test(config, motion).problems
    assert verdict.startswith("NO-GO: mass ratio 0.650 is above the allowable")
    step = RthsLoop(config, motion).run().steps
    assert limit.startswith(
        f"the prediction passes a limit after {step * DT:.3f} s: "
        f"safety.stability_limit [1] passed at step {step}: stability indicator 0.7"
    )


def test_no_go_is_a_problem_also_when_no_limit_is_looked_at():
    config, motion = el_centro(load_config(EIGHT_STORY), ground_motion__duration=0.5, **WITHOUT_LIMITS)
    (problem,) = predict_test(config, motion).problems
    assert problem.startswith("NO-GO")


def test_substructure_without_damping_cannot_be_judged():
    config, motion = el_centro(
        Config(), ground_motion__duration=0.5, numerical_substructure__damping_coefficients=[0.0]
    )
    (problem,) = predict_test(config, motion).problems
    assert problem.startswith("stability cannot be judged: ")
    assert "damping" in problem


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"safety__acceleration_limit": 1.0, "safety__ramp_acceleration": 1.0},
            "safety.acceleration_limit [m/s2] passed at step",
        ),
        ({"safety__displacement_limit": 0.02}, "safety.displacement_limit [m] passed at step"),
        ({"safety__velocity_limit": 0.05, "safety__ramp_velocity": 0.05}, "safety.velocity_limit [m/s] passed at step"),
        ({"safety__force_limit": 4000.0}, "safety.force_limit [N] passed at step"),
    ],
)
def test_passed_limit_is_named_with_value_step_and_time(changes, told):
    config, motion = el_centro(Config(), ground_motion__duration=8.0, **changes)
    preflight = predict_test(config, motion)
    (problem,) = preflight.problems
    assert told in problem
    assert f"allowed is {next(iter(changes.values())):g}" in problem
    assert not preflight.cleared
    name = next(iter(changes))
    config = config.changed(**{name.replace("_limit", "_action"): "indicate"})
    assert predict_test(config, motion).cleared


def test_limit_passed_by_the_sensors_of_the_last_step_is_a_problem():
    """It has no next command to be refused, so that the run itself finishes."""
    config, motion = el_centro(Config(), ground_motion__duration=8.0)
    force = np.abs(RthsLoop(config, motion).run().actuator_force)
    last = int(force.argmax())
    config = config.changed(ground_motion__duration=last * DT, safety__force_limit=0.999 * force[last])
    motion = GroundMotion("cut", DT, motion.acceleration[: last + 1], "test", "0" * 64)
    assert RthsLoop(config, motion).run().outcome == "finished"
    (problem,) = predict_test(config, motion).problems
    assert f"after {last * DT:.3f} s: safety.force_limit [N] passed at step {last}" in problem


def test_stroke_of_a_displacement_controlled_table_is_checked():
    """Behind the high-pass the way from 0.1 to -0.1 m overshoots, because the table has begun to return before."""
    config = QUIET.changed(safety__displacement_limit=0.13)
    motion = moved_ground(0.1, -0.1, 0.0)
    assert RthsLoop(config, motion).run().outcome == "finished"
    (problem,) = predict_test(config, motion).problems
    assert "safety.displacement_limit [m]" in problem
    assert "displacement a displacement-controlled table is asked for -0.13" in problem


def test_progress_is_told_up_to_the_last_step():
    config, motion = el_centro(Config(), ground_motion__duration=2.0)
    told = []
    predict_test(config, motion, told.append)
    assert told == [200, 400, 401]
