"""What is computed while a run is under way is what is computed afterwards, and what closed forms say."""

import math
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core import RthsLoop, load_config, select_ground_motion
from bmd_rths_core.analysis.limit_use import WATCHED, LimitWatch
from bmd_rths_core.analysis.live_signals import GrowingColumns, LiveSignals
from bmd_rths_core.analysis.moving_tracking import MovingTracking
from bmd_rths_core.analysis.supervised_peaks import largest_increment, largest_tracking_error
from bmd_rths_core.analysis.table_peaks import table_peaks
from bmd_rths_core.table.controller import TableMeasurement

CONFIG = Path(__file__).parents[2] / "config" / "simplified_bmd.yaml"

DT = 0.005


@pytest.fixture(scope="module")
def record():
    config = load_config(CONFIG).changed(ground_motion__duration=4.0)
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


def portions(steps, seed):
    """Cut some steps into portions of any length, none of them empty."""
    cuts = np.sort(np.random.default_rng(seed).choice(np.arange(1, steps), 40, replace=False))
    return [*cuts.tolist(), steps]


# ---- columns


def test_columns_keep_what_was_put_whatever_the_order_and_have_nan_elsewhere():
    rng = np.random.default_rng(1)
    rows = rng.choice(20_000, 500, replace=False)
    columns = GrowingColumns()
    for row in rows:
        columns.put("a", int(row), float(row))
        columns.put("b", int(row), np.array([row, -row], dtype=float))
    expected = np.full(rows.max() + 1, np.nan)
    expected[rows] = rows
    assert np.array_equal(columns["a"], expected, equal_nan=True)
    assert np.array_equal(columns["b"], np.column_stack((expected, -expected)), equal_nan=True)
    assert np.isnan(columns["never"]).all()
    assert len(columns["never"]) == columns.rows


def test_short_column_is_as_long_as_the_others():
    columns = GrowingColumns()
    columns.put("short", 0, 1.0)
    columns.put("long", 9_999, 2.0)
    assert columns["short"].shape == (10_000,)
    assert np.isnan(columns["short"][1:]).all()


def test_a_step_is_complete_when_every_topic_has_come(record):
    signals = LiveSignals()
    assert (signals.steps, signals.complete) == (0, 0)
    for name in ("ground_acceleration", "desired_acceleration", "required_force", "command", "interface_force"):
        signals.put(name, 0, 1.0)
    signals.put("corrected_force", 1, 1.0)  # that of step 0 was lost
    assert (signals.steps, signals.complete) == (2, 0)
    signals.put_measurement(TableMeasurement(0, 1.0, 2.0, 3.0, 4.0, 5.0, np.array([6.0, 7.0])))
    assert (signals.floors, signals.complete) == (2, 1)
    assert signals.signals().keys() == record.signals().keys()


# ---- tracking


@pytest.mark.parametrize("delay_ms", [0.0, 2.5, 20.0, -5.0])
def test_delay_and_amplitude_of_a_sine_are_found_in_every_window(delay_ms):
    """The table is measured at the end of a step: without delay, its row k is the desired motion of row k + 1."""
    time, frequency = DT * np.arange(2001), 3.0
    moving = MovingTracking(DT)
    moving.advance(
        np.sin(2 * np.pi * frequency * time), 0.9 * np.sin(2 * np.pi * frequency * (time + DT - 1e-3 * delay_ms))
    )
    assert len(moving.windows) == 81
    assert moving.windows[0].end == 2.0
    phase = 2 * np.pi * frequency * 1e-3 * delay_ms
    for window in moving.windows:
        assert window.delay_ms == pytest.approx(delay_ms, abs=1e-3)
        assert window.amplitude == pytest.approx(0.9, abs=1e-4)
        assert window.frequency_hz == pytest.approx(frequency, rel=1e-3)
        # By trapezoids the area of a step is that of the chord: sin(ω Δt) in the place of ω Δt.
        chord = math.sin(2 * np.pi * frequency * DT) / (2 * np.pi * frequency * DT)
        assert window.indicator == pytest.approx(0.9 * math.sin(phase) * chord, abs=2e-3)
        # |1 − 0.9 e^(iφ)|, as the windows hold whole periods
        assert window.error_percent == pytest.approx(1e2 * abs(1 - 0.9 * np.exp(1j * phase)), rel=1e-6)


def test_windows_do_not_depend_on_how_the_steps_come(record):
    whole, pieces = MovingTracking(DT), MovingTracking(DT)
    whole.advance(record.desired_acceleration, record.table_acceleration)
    for end in portions(record.steps, 2):
        pieces.advance(record.desired_acceleration[:end], record.table_acceleration[:end])
    assert pieces.windows == whole.windows
    assert len(whole.windows) > 10


def test_a_quiet_window_and_what_was_not_measured_tell_nothing():
    time = DT * np.arange(1601)
    desired = np.where(time < 4.0, np.sin(20.0 * time), 0.001 * np.sin(20.0 * time))
    achieved = np.append(desired[1:], 0.0)
    achieved[100:200] = np.nan
    moving = MovingTracking(DT)
    moving.advance(desired, achieved)
    assert max(window.end for window in moving.windows) < 6.0
    assert all(abs(window.delay_ms) < 1e-9 for window in moving.windows)
    silent = MovingTracking(DT)
    silent.advance(np.zeros(1000), np.zeros(1000))
    assert silent.windows == []


# ---- limits


def test_peaks_are_those_of_the_whole_record(record):
    safety = load_config(CONFIG).safety
    watch = LimitWatch(safety, DT)
    for end in portions(record.steps, 3):
        watch.advance(record.signals(), end)
    use = watch.use(record.steps, 0.5)
    peaks = table_peaks(record)
    assert {name: found.peak for name, found in use.items()} == {
        "displacement": peaks.displacement,
        "velocity": peaks.velocity,
        "acceleration": np.abs(record.command).max(),
        "increment": largest_increment(record),
        "tracking": pytest.approx(largest_tracking_error(record, safety), rel=1e-12),
        "force": peaks.force,
    }
    assert {watched.name for watched in WATCHED} == set(use)
    assert use["force"].limit == safety.force_limit
    assert use["displacement"].now == np.abs(record.table_displacement[-100:]).max()


def test_limits_at_a_step_in_the_past(record):
    watch = LimitWatch(load_config(CONFIG).safety, DT)
    watch.advance(record.signals(), record.steps)
    use = watch.use(300, 0.05)["displacement"]
    assert use.peak == np.abs(record.table_displacement[:300]).max()
    assert use.now == np.abs(record.table_displacement[290:300]).max()


def test_what_is_not_measured_is_not_a_number():
    gone = np.full(50, np.nan)
    signals = dict.fromkeys(
        ("table_displacement", "command", "applied_command", "actuator_force", "table_acceleration"), gone
    )
    watch = LimitWatch(load_config(CONFIG).safety, DT)
    assert all(math.isnan(use.peak) for use in watch.use(0, 0.5).values())
    watch.advance(signals, 50)
    assert all(math.isnan(use.now) and math.isnan(use.peak) for use in watch.use(50, 0.5).values())
