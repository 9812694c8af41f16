"""Metrics against closed forms."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bmd_rths_core.analysis.metrics import rmse_percent, run_metrics, tracking_delay
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.rths_loop import RthsLoop

DT = 0.005
TIME = np.arange(2000) * DT


def test_rmse_is_equation_12():
    assert rmse_percent(np.array([3.0, 4.0]), np.array([3.0, 1.0])) == pytest.approx(60.0)


def test_rmse_of_a_pure_delay_has_the_closed_form():
    """Whole periods of a sine delayed by a phase φ differ by 2 sin(φ/2)."""
    phase = 0.7
    angle = 2 * np.pi * np.arange(1000) / 100
    assert rmse_percent(np.sin(angle), np.sin(angle - phase)) == pytest.approx(200.0 * np.sin(phase / 2), rel=1e-9)


def test_rmse_leaves_out_what_was_not_recorded():
    reference = np.array([1.0, 2.0, 3.0])
    assert rmse_percent(reference, np.array([1.0, np.nan, 3.0])) == 0.0
    assert np.isnan(rmse_percent(np.zeros(3), np.ones(3)))


@given(st.floats(-0.05, 0.05))
def test_tracking_delay_finds_a_delay_between_the_samples(delay):
    def pulse(time):
        return np.exp(-(((time - 5.0) / 0.05) ** 2)) * np.cos(30.0 * (time - 5.0))

    assert tracking_delay(pulse(TIME), pulse(TIME - delay), DT) == pytest.approx(delay, abs=2e-4)


def test_tracking_delay_of_nothing_is_nan():
    assert np.isnan(tracking_delay(np.zeros(100), np.ones(100), DT))
    assert np.isnan(tracking_delay(np.ones(1), np.ones(1), DT))  # a limit has ended the run at its first steps


def test_perfect_table_tracks_one_step_late_and_floors_are_compared_at_the_time_of_their_sensors():
    """The sensors are read at the end of the hold, one step after the desired acceleration they answer."""
    config = Config().changed(
        run__scheme="uc",
        simulated_table__dynamics="perfect",
        simulated_table__acceleration_noise=0.0,
        simulated_table__shear_noise=0.0,
        simulated_table__displacement_noise=0.0,
        simulated_table__force_noise=0.0,
    )
    acceleration = np.sin(2 * np.pi * 1.5 * TIME) * np.exp(-(((TIME - 5.0) / 2.0) ** 2))
    record = RthsLoop(config, GroundMotion("pulse", DT, acceleration, "test", "0" * 64)).run()
    metrics = run_metrics(record)
    assert metrics.tracking_delay_ms == pytest.approx(5.0, abs=0.1)
    assert max(metrics.rmse_percent.values()) < 5.0
    assert metrics.missing_values == 0
    assert metrics.rmse_percent["control_layer"] == metrics.floor_rmse_percent[0]
    assert metrics.rmse_percent["superstructure"] == metrics.floor_rmse_percent[-1]


@pytest.mark.parametrize(
    "nonlinear",
    [{}, {"nonlinear__integration": "cr", "nonlinear__story_model": "bilinear", "nonlinear__yield_drifts": [1e-4]}],
)
@pytest.mark.parametrize("steps", [0, 1, 2])
def test_record_that_ended_at_once_has_no_errors_but_can_be_looked_at(steps, nonlinear):
    config = Config().changed(**nonlinear)
    record = RthsLoop(config, GroundMotion("pulse", DT, np.ones(400), "test", "0" * 64)).run()
    cut = dataclasses.replace(record, **{name: signal[:steps] for name, signal in record.signals().items()})
    metrics = run_metrics(cut)
    assert all(np.isnan(value) for value in metrics.rmse_percent.values()) == (steps < 2)
    without_sensors = dataclasses.replace(cut, floor_accelerations=np.zeros((steps, 0)))
    assert np.isnan(run_metrics(without_sensors).rmse_percent["superstructure"])
