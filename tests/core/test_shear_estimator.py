"""Kalman shear estimator: steady-state gain proven equal to the full filter, accuracy, noise, load cells."""

import subprocess
import sys

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.stages.shear_estimator import (
    ShearEstimator,
    ShearEstimatorConfig,
    kalman_filter,
    steady_state_filter,
)
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.simulated import SimulatedTable
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig

DT = 0.005
SPECIMEN = Config().specimen.building()
EIGHT_STORY = (
    Config()
    .changed(
        specimen__masses=[760.0, 800.0, 800.0, 800.0, 800.0],
        specimen__stiffnesses=[2495320.0, *[4941700.0] * 4],
        specimen__damping_coefficients=[3330.0, *[78.0] * 4],
    )
    .specimen.building()
)


def measurements(specimen, table_config, commands, seed=0):
    table = SimulatedTable(table_config, specimen, DT, seed)
    return [table.exchange(TableCommand(k, a)) for k, a in enumerate(commands)]


def smooth_commands(n):
    time = np.arange(n) * DT
    return np.sin(2 * np.pi * 2.3 * time) + 0.5 * np.sin(2 * np.pi * 5.5 * time)


def test_filter_that_is_shared_cannot_be_altered():
    first, again = (steady_state_filter(ShearEstimatorConfig(), SPECIMEN, DT) for _ in range(2))
    assert again is first
    assert steady_state_filter(ShearEstimatorConfig(model_error=0.2), SPECIMEN, DT).gain != pytest.approx(first.gain)
    for array in first:
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0


@pytest.mark.parametrize("specimen", [SPECIMEN, EIGHT_STORY], ids=["simplified", "eight-story"])
def test_steady_state_gain_is_the_one_the_full_filter_converges_to(specimen):
    kalman, _ = kalman_filter(ShearEstimatorConfig(), specimen, DT)
    gain, covariance = kalman.K.copy(), kalman.P.copy()
    kalman.P = np.eye(2 * specimen.stories)
    for _ in range(5000):
        kalman.predict(np.zeros(2), np.zeros((2 * specimen.stories, 2)))
        kalman.update(np.zeros(specimen.stories))
    assert pytest.approx(gain, rel=1e-6, abs=1e-9 * np.abs(gain).max()) == kalman.K
    assert pytest.approx(covariance, rel=1e-6, abs=1e-9 * np.abs(covariance).max()) == kalman.P


def test_estimates_equal_those_of_the_full_filter():
    readings = measurements(SPECIMEN, SimulatedTableConfig(), smooth_commands(400))
    config = ShearEstimatorConfig()
    estimator = ShearEstimator(config, SPECIMEN, DT)
    ours = np.array([estimator.step(m) for m in readings])
    full, input_matrix = kalman_filter(config, SPECIMEN, DT)  # starts with the steady-state covariance
    before, theirs = 0.0, []
    for m in readings:
        full.predict(np.array([before, m.table_acceleration]), input_matrix)
        full.update(m.floor_accelerations)
        before = m.table_acceleration
        theirs.append(-np.asarray(SPECIMEN.masses) @ full.H @ full.x)
    assert ours == pytest.approx(np.array(theirs), rel=1e-9, abs=1e-6)


def test_estimate_is_much_nearer_to_the_true_shear_than_the_raw_sensors():
    noisy = measurements(SPECIMEN, SimulatedTableConfig(shear_noise=0.0), smooth_commands(4000))
    true_shear = np.array([m.base_shear for m in noisy])
    raw = np.array([-np.asarray(SPECIMEN.masses) @ m.floor_accelerations for m in noisy])
    estimator = ShearEstimator(ShearEstimatorConfig(), SPECIMEN, DT)
    estimate = np.array([estimator.step(m) for m in noisy])
    assert np.std(estimate - true_shear) < 0.5 * np.std(raw - true_shear)


def test_estimate_without_noise_is_the_true_shear_up_to_the_hold_of_the_input():
    quiet = SimulatedTableConfig(acceleration_noise=0.0, shear_noise=0.0)
    readings = measurements(SPECIMEN, quiet, smooth_commands(2000))
    true_shear = np.array([m.base_shear for m in readings])
    estimator = ShearEstimator(ShearEstimatorConfig(), SPECIMEN, DT)
    estimate = np.array([estimator.step(m) for m in readings])
    assert np.std(estimate - true_shear) < 0.01 * np.std(true_shear)


def test_reset_returns_to_rest():
    readings = measurements(SPECIMEN, SimulatedTableConfig(), smooth_commands(50))
    estimator = ShearEstimator(ShearEstimatorConfig(), SPECIMEN, DT)
    first = [estimator.step(m) for m in readings]
    estimator.reset()
    assert [estimator.step(m) for m in readings] == first


def test_load_cell_path_gives_the_load_cells():
    readings = measurements(SPECIMEN, SimulatedTableConfig(), smooth_commands(20))
    estimator = ShearEstimator(ShearEstimatorConfig(source="load_cell"), SPECIMEN, DT)
    assert [estimator.step(m) for m in readings] == [m.base_shear for m in readings]


#: In a process that has loaded nothing yet: the filter is that of filterpy, and who wants a likelihood gets it.
WITHOUT_STATS = """
import math, sys
from bmd_rths_core.stages.filterpy_loader import kalman_filter_class
kalman = kalman_filter_class()(dim_x=1, dim_z=1)
assert {"scipy.stats", "scipy.ndimage"}.isdisjoint(sys.modules)
import filterpy.kalman, filterpy.stats
assert type(kalman) is filterpy.kalman.KalmanFilter is kalman_filter_class()
kalman.predict()
kalman.update(0.5)
assert "scipy.stats" not in sys.modules
wanted = -0.5 * (math.log(2.0 * math.pi * kalman.S.item()) + kalman.y.item() ** 2 / kalman.S.item())
assert abs(kalman.log_likelihood - wanted) < 1e-12, (kalman.log_likelihood, wanted)
import scipy.stats
assert abs(filterpy.stats.stats.norm(0.0, 1.0).pdf(0.0) - scipy.stats.norm.pdf(0.0)) < 1e-15
from filterpy.discrete_bayes import predict
assert abs(predict([0.0, 1.0, 0.0], 1, [0.1, 0.8, 0.1])[2] - 0.8) < 1e-12
"""


@pytest.mark.slow
def test_filter_is_that_of_filterpy_without_waiting_for_what_it_does_not_use():
    done = subprocess.run([sys.executable, "-c", WITHOUT_STATS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
