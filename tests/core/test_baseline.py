"""Baseline correction and time axis of ground motions, against closed forms and on a real record that drifts."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import GroundMotion, high_pass, read_ground_motion, scale_time
from bmd_rths_core.ground_motion.config import GroundMotionConfig, prepare_ground_motion, select_ground_motion
from tests.conftest import ground_motion_folder, needs

STEP = 0.01
#: KiK-net record of Kumamoto that has its offset in it.
KUMAMOTO = ground_motion_folder() / "Kumamoto" / "KMMH161604160125.NS2"


def motion_of(acceleration, time_step=STEP):
    return GroundMotion("test", time_step, acceleration, "test", "0" * 64)


def displacement_of(motion):
    """Integrate twice from rest, by trapezia."""
    steps = motion.time_step * 0.5 * (motion.acceleration[1:] + motion.acceleration[:-1])
    velocity = np.concatenate(([0.0], np.cumsum(steps)))
    return np.concatenate(([0.0], np.cumsum(motion.time_step * 0.5 * (velocity[1:] + velocity[:-1]))))


@pytest.mark.parametrize("frequency", [0.2, 0.5, 1.0, 4.0])
def test_a_sine_keeps_its_phase_and_has_the_gain_of_butterworth(frequency):
    """Twice through order 2: |H|^2 = 1 / (1 + (f_c / f)^4)."""
    corner, time = 0.5, STEP * np.arange(20_000)
    filtered = high_pass(motion_of(np.sin(2 * np.pi * frequency * time)), corner)
    extension = (filtered.steps - len(time)) // 2
    assert extension * STEP == pytest.approx(3.0 / corner)
    inside = slice(5000, 15_000)  # far from both ends, where only the steady state is left
    gain = 1.0 / (1.0 + (corner / frequency) ** 4)
    expected = gain * np.sin(2 * np.pi * frequency * time[inside])
    assert filtered.acceleration[extension:-extension][inside] == pytest.approx(expected, abs=1e-5)


def test_it_is_the_filter_of_scipy_that_runs_both_ways():
    """The bilinear transform of scipy bends frequencies near that of Nyquist, so the record has none there."""
    record = motion_of(np.convolve(np.random.default_rng(1).standard_normal(4000), np.hanning(80) / 40.0, "same"))
    filtered = high_pass(record, 0.3)
    extension = (filtered.steps - record.steps) // 2
    sections = butter(2, 0.3, "highpass", fs=1.0 / STEP, output="sos")
    expected = sosfiltfilt(sections, np.pad(record.acceleration - record.acceleration.mean(), extension), padtype=None)
    assert filtered.acceleration == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def test_an_offset_no_longer_becomes_a_drift():
    time = STEP * np.arange(6000)
    pulse = np.exp(-0.5 * ((time - 20.0) / 0.1) ** 2)
    drifting = motion_of(pulse + 0.01 - 0.002 * (time > 30.0))
    assert abs(displacement_of(drifting)[-1]) > 10.0
    corrected = displacement_of(high_pass(drifting, 0.1))
    assert np.abs(corrected).max() < 0.5
    assert corrected[-1] == pytest.approx(0.0, abs=1e-3)


@needs(KUMAMOTO)
def test_a_real_record_that_drifts_comes_back_to_rest():
    record = read_ground_motion(str(KUMAMOTO))
    assert np.abs(displacement_of(record)).max() > 1.0
    displacement = displacement_of(high_pass(record, 0.1))
    assert np.abs(displacement).max() < 1.0
    assert displacement[-1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("frequency", [0.0, -1.0, 50.0, float("nan")])
def test_bad_corner_is_refused(frequency):
    with pytest.raises(InputError, match=r"high-pass frequency .* can be filtered above 0 and below 50 Hz"):
        high_pass(motion_of(np.ones(10)), frequency)


def test_compressed_time_keeps_accelerations_and_squares_into_displacements():
    record = motion_of(np.sin(0.1 * np.arange(500)))
    compressed = scale_time(record, 0.5)
    assert compressed.time_step == 0.5 * STEP
    assert np.array_equal(compressed.acceleration, record.acceleration)
    assert displacement_of(compressed) == pytest.approx(0.25 * displacement_of(record), rel=1e-12)


@pytest.mark.parametrize("factor", [0.0, -1.0, float("inf"), float("nan")])
def test_bad_time_scale_is_refused(factor):
    with pytest.raises(InputError, match=r"time scale .* a finite number > 0 is required"):
        scale_time(motion_of(np.ones(10)), factor)


def test_the_filter_of_a_selected_motion_belongs_to_the_time_axis_of_the_record():
    filtered = GroundMotionConfig(high_pass_frequency=0.1, peak_acceleration=0.0)
    compressed = GroundMotionConfig(high_pass_frequency=0.1, time_scale=0.5, peak_acceleration=0.0)
    whole = select_ground_motion(filtered, 0.02)
    half = select_ground_motion(compressed, 0.01)
    assert half.acceleration == pytest.approx(whole.acceleration, rel=1e-9, abs=1e-12)
    assert half.time_step == 0.01


def test_a_test_lasts_as_long_as_was_asked_for():
    motion = select_ground_motion(GroundMotionConfig(time_scale=0.577, duration=4.0), 0.005)
    assert motion.steps == 801
    assert motion.acceleration[-2:] == pytest.approx(0.0, abs=0.2)  # cut at 3.993 s
    assert motion.acceleration[-1] == 0.0


def test_duration_is_that_of_the_test():
    compressed = GroundMotionConfig(time_scale=0.5, duration=4.0, peak_acceleration=0.0)
    whole = select_ground_motion(GroundMotionConfig(peak_acceleration=0.0), 0.02)
    assert np.array_equal(select_ground_motion(compressed, 0.01).acceleration, whole.acceleration[:401])


def test_a_time_scale_need_not_fit_the_step_of_the_loop_when_the_record_does():
    record = motion_of(np.sin(0.02 * np.arange(2000)))
    scaled = prepare_ground_motion(record, GroundMotionConfig(time_scale=0.577, peak_acceleration=0.0), 0.005)
    time = 0.005 * np.arange(scaled.steps)
    inside = (time > 0.5) & (time < time[-1] - 0.5)
    assert scaled.acceleration[inside] == pytest.approx(np.sin(0.02 * time[inside] / (0.577 * STEP)), abs=2e-4)


def test_steps_that_fit_neither_before_nor_after_the_time_scale_are_refused():
    with pytest.raises(InputError, match=r"time step 0\.004 s; ground motion 'test' has 0\.01 s"):
        prepare_ground_motion(motion_of(np.ones(10)), GroundMotionConfig(time_scale=0.3), 0.004)


def test_without_being_asked_nothing_is_corrected():
    record = motion_of(np.linspace(0.0, 1.0, 100), 0.005)
    unchanged = prepare_ground_motion(record, GroundMotionConfig(peak_acceleration=0.0), 0.005)
    assert np.array_equal(unchanged.acceleration, record.acceleration)
