"""What is missing in a record stands beside the numbers: what it may have changed, or no numbers."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bmd_rths_core.analysis.missing_rows import EVERY_STEP, LARGEST_SHARE, missing_rows
from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.report.wording import problems

NUMBERS = ("rmse_percent.substructure", "rmse_percent.superstructure", "tracking_delay_ms")


@cache
def whole():
    config = Config().changed(ground_motion__duration=6.0)
    return analysed(RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run(), False)


def with_gaps(share, names, seed=1, burst=1):
    """Leave a share of the rows of some signals out, in bursts; each signal loses its own."""
    record, rng, changed = whole().record, np.random.default_rng(seed), {}
    for name in names:
        signal = np.array(getattr(record, name))
        for begin in rng.integers(0, record.steps - burst, max(1, int(share * record.steps / burst))):
            signal[begin : begin + burst] = np.nan
        changed[name] = signal
    return replace(record, **changed)


def numbers(analysis):
    errors = analysis.metrics.rmse_percent
    return (errors["substructure"], errors["superstructure"], analysis.metrics.tracking_delay_ms)


def test_whole_record_has_nothing_missing():
    assert (whole().gaps.share, dict(whole().gaps.changes)) == (0.0, {})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "burst"),
    [(EVERY_STEP, 1), (("ground_acceleration",), 8), (("floor_accelerations", "table_acceleration"), 20)],
)
def test_what_gaps_have_changed_is_of_the_size_that_is_told(names, burst):
    """In ten samples no change is more than twice of what is told, and that is not more than ten times too large."""
    told, real = [], []
    for seed in range(10):
        analysis = analysed(with_gaps(0.05, names, seed, burst), False)
        assert 0.0 < analysis.gaps.share < LARGEST_SHARE
        told.append([analysis.gaps.changes[name] for name in NUMBERS])
        real.append(np.abs(np.subtract(numbers(analysis), numbers(whole()))))
    told, real = np.array(told), np.array(real)
    assert (real <= 2.0 * told + 1e-9).all()
    moved = real.max(axis=0) > 1e-9
    assert moved.any()
    assert (told.max(axis=0)[moved] <= 10.0 * real.max(axis=0)[moved]).all()


def test_errors_of_a_record_that_lacks_too_much_are_not_given():
    analysis = analysed(with_gaps(0.3, ("ground_acceleration",)), False)
    assert analysis.gaps.too_many
    assert np.isnan(numbers(analysis)).all()
    assert np.isnan([analysis.quality.tracking.delay_ms, *analysis.quality.rmse_true_percent.values()]).all()
    assert any("Errors and delay are not given: a signal lacks" in problem for problem in problems(analysis, 0.0))


def test_sensor_that_a_laboratory_lacks_is_no_gap():
    record = replace(whole().record, floor_accelerations=np.full((whole().record.steps, 2), np.nan))
    assert missing_rows(record, lambda _: {}).share == 0.0


def test_gaps_are_told_in_words():
    analysis = analysed(with_gaps(0.02, ("table_acceleration",)), False)
    (told,) = [problem for problem in problems(analysis, 0.0) if problem.startswith("What is missing")]
    assert "points and the delay by " in told
