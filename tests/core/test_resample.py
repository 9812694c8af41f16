"""Processing of ground motions: no aliasing, no phase shift, no point moved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import (
    GroundMotion,
    fade_in,
    interpolate,
    pad,
    read_ground_motion,
    resample,
    scale_to_peak,
    truncate,
)
from bmd_rths_core.ground_motion.config import GroundMotionConfig, select_ground_motion

FloatArray = NDArray[np.float64]

RIPPLE = 1e-4  # documented: 0.01 % in the pass band, -80 dB in the stop band
EDGE = 26  # documented: points of the coarser record over which an edge rings

RATIOS = st.integers(2, 12)
RECORDS = arrays(np.float64, st.integers(2, 80), elements=st.floats(-20.0, 20.0, allow_subnormal=False))


def motion_of(acceleration: FloatArray, time_step: float = 0.02) -> GroundMotion:
    return GroundMotion("test", time_step, acceleration, "test", "0" * 64)


def impulse_response(ratio: int, *, coarser: bool) -> FloatArray:
    """Return the taps of the filter, measured from the outside: centred, at the finer of the two rates."""
    side = 40
    if not coarser:
        impulse = np.zeros(2 * side + 1)
        impulse[side] = 1.0
        return resample(motion_of(impulse, 1.0), 1.0 / ratio).acceleration
    # A filter followed by decimation is seen one phase at a time: an impulse j points late shows taps j, j - ratio, ...
    centre = side * ratio
    taps = np.zeros(2 * centre + 1)
    for late in range(ratio):
        impulse = np.zeros(2 * centre + 1)
        impulse[centre + late] = 1.0
        # point n of the result is tap n * ratio - (centre + late), and index k of `taps` is tap k - centre
        response = resample(motion_of(impulse, 1.0), float(ratio)).acceleration
        indices = np.arange(response.size) * ratio - late
        taps[indices[indices >= 0]] = response[indices >= 0]
    return taps


def gain_of(taps: FloatArray, ratio: int) -> tuple[FloatArray, FloatArray]:
    """Return frequencies, in Nyquist frequencies of the coarser rate, and the (real, signed) gain of centred taps."""
    frequency = np.linspace(0.0, ratio, 400 * ratio + 1)
    position = (np.arange(taps.size) - taps.size // 2) / ratio
    return frequency, np.array([taps @ np.cos(np.pi * f * position) for f in frequency])


# ------------------------------------------------------------------------------------------------ the filters


@pytest.mark.parametrize("ratio", [2, 3, 4, 5, 20])
def test_finer_filter_keeps_its_promised_bands(ratio: int) -> None:
    taps = impulse_response(ratio, coarser=False)
    np.testing.assert_array_equal(taps, taps[::-1])  # symmetric about its centre: zero phase at every frequency
    assert np.flatnonzero(taps).min() >= (40 - EDGE) * ratio
    frequency, gain = gain_of(taps, ratio)
    assert np.max(np.abs(gain[frequency <= 0.9] / ratio - 1.0)) < RIPPLE
    assert np.max(np.abs(gain[frequency >= 1.1] / ratio)) < RIPPLE


@pytest.mark.parametrize("ratio", [2, 3, 4, 5, 20])
def test_coarser_filter_keeps_its_promised_bands(ratio: int) -> None:
    taps = impulse_response(ratio, coarser=True)
    np.testing.assert_array_equal(taps, taps[::-1])
    assert np.flatnonzero(taps).min() >= (40 - EDGE) * ratio
    frequency, gain = gain_of(taps, ratio)
    assert np.max(np.abs(gain[frequency <= 0.8] - 1.0)) < RIPPLE
    assert np.max(np.abs(gain[frequency >= 1.0])) < RIPPLE


# ---------------------------------------------------------------------------------------------- finer time step


@given(record=RECORDS, ratio=RATIOS)
def test_finer_keeps_every_given_point_exactly(record: FloatArray, ratio: int) -> None:
    finer = resample(motion_of(record), 0.02 / ratio)
    assert finer.time_step == 0.02 / ratio
    assert finer.steps == (record.size - 1) * ratio + 1
    np.testing.assert_array_equal(finer.acceleration[::ratio], record)


@pytest.mark.parametrize("part_of_nyquist", [0.02, 0.3, 0.6, 0.9])
@pytest.mark.parametrize("time_step", [0.01, 0.005, 0.001])
def test_finer_sine_is_the_sine_itself(part_of_nyquist: float, time_step: float) -> None:
    frequency = part_of_nyquist * 0.5 / 0.02
    given_time = 0.02 * np.arange(400)
    motion = resample(motion_of(np.sin(2 * np.pi * frequency * given_time + 0.7)), time_step)
    time = time_step * np.arange(motion.steps)
    error = np.abs(motion.acceleration - np.sin(2 * np.pi * frequency * time + 0.7))
    inside = (time >= EDGE * 0.02) & (time <= given_time[-1] - EDGE * 0.02)
    # Ripple and image each add up to 1e-4. A delay of one fine sample (1 ms) would show as 0.0016 or more.
    assert error[inside].max() < 2 * RIPPLE


@pytest.mark.parametrize("ratio", [2, 4])
def test_finer_agrees_with_fourier_interpolation(ratio: int) -> None:
    record = band_limited_el_centro(0.85)
    fourier = scipy.signal.resample(record, record.size * ratio)[: (record.size - 1) * ratio + 1]
    finer = resample(motion_of(record), 0.02 / ratio).acceleration
    assert np.max(np.abs(finer - fourier)) < 2 * RIPPLE * np.max(np.abs(record))


# -------------------------------------------------------------------------------------------- coarser time step


@given(record=RECORDS, ratio=RATIOS)
def test_coarser_has_one_point_for_every_begun_step(record: FloatArray, ratio: int) -> None:
    expected = -(-record.size // ratio)
    motion = motion_of(record, 0.005)
    if expected < 2:
        with pytest.raises(InputError, match=r"one point of acceleration; two or more are required"):
            resample(motion, 0.005 * ratio)
    else:
        coarser = resample(motion, 0.005 * ratio)
        assert coarser.steps == expected
        assert coarser.time_step == 0.005 * ratio


@pytest.mark.parametrize("part_of_nyquist", [0.02, 0.4, 0.8])
@pytest.mark.parametrize("ratio", [2, 4, 5])
def test_coarser_sine_below_the_pass_band_edge_is_kept(part_of_nyquist: float, ratio: int) -> None:
    frequency = part_of_nyquist * 0.5 / (0.005 * ratio)
    motion = motion_of(np.sin(2 * np.pi * frequency * 0.005 * np.arange(1000) + 0.7), 0.005)
    coarser = resample(motion, 0.005 * ratio)
    expected = np.sin(2 * np.pi * frequency * coarser.time_step * np.arange(coarser.steps) + 0.7)
    inside = slice(EDGE, coarser.steps - EDGE - 1)
    assert np.max(np.abs(coarser.acceleration - expected)[inside]) < RIPPLE


@pytest.mark.parametrize("part_of_nyquist", [1.0, 1.2, 1.6, 2.0, 3.3])
@pytest.mark.parametrize("ratio", [4, 5])
def test_coarser_sine_beyond_the_new_nyquist_frequency_does_not_fold_back(part_of_nyquist: float, ratio: int) -> None:
    frequency = part_of_nyquist * 0.5 / (0.005 * ratio)
    motion = motion_of(np.sin(2 * np.pi * frequency * 0.005 * np.arange(1000) + 0.7), 0.005)
    coarser = resample(motion, 0.005 * ratio)
    inside = slice(EDGE, coarser.steps - EDGE - 1)
    assert np.max(np.abs(motion.acceleration[::ratio][inside])) > 0.5  # plain decimation would fold it back
    assert np.max(np.abs(coarser.acceleration[inside])) < RIPPLE


@pytest.mark.parametrize("ratio", [2, 4])
def test_coarser_agrees_with_fourier_decimation(ratio: int) -> None:
    record = band_limited_el_centro(0.8 / ratio)
    fourier = scipy.signal.resample(record, record.size // ratio)
    coarser = resample(motion_of(record), 0.02 * ratio).acceleration
    assert np.max(np.abs(coarser - fourier)) < 2 * RIPPLE * np.max(np.abs(record))


def band_limited_el_centro(part_of_nyquist: float) -> FloatArray:
    """Return the record without its content above a part of its Nyquist frequency, at rest at both ends."""
    record = read_ground_motion("el_centro_1940_ns").acceleration
    record = np.pad(record * scipy.signal.windows.tukey(record.size, 0.1), 200)[:1952]
    spectrum = np.fft.rfft(record)
    frequency = np.linspace(0.0, 1.0, spectrum.size)
    # a gentle roll-off, so that the band limit does not ring up to the ends of the record
    return np.fft.irfft(spectrum * np.clip((part_of_nyquist - frequency) / 0.1, 0.0, 1.0), record.size)


# ------------------------------------------------------------------------------------------------- any time step


@pytest.mark.parametrize("time_step", [0.02 / 3, 0.02 / 2.31, 0.02 / 1.154, 0.02 * 1.3, 0.02 * np.sqrt(3.0), 0.1])
def test_any_time_step_has_the_sines_below_the_pass_band_edge(time_step: float) -> None:
    edge = 0.5 * (0.9 / 0.02 if time_step < 0.02 else 0.8 / time_step)
    for frequency in edge * np.array([0.02, 0.5, 1.0]):
        motion = interpolate(motion_of(np.sin(2 * np.pi * frequency * 0.02 * np.arange(900) + 0.7)), time_step)
        assert motion.time_step == time_step
        time = time_step * np.arange(motion.steps)
        assert time[-1] <= 0.02 * 899 * (1 + 1e-12) < time[-1] + time_step
        inside = (time >= EDGE * max(0.02, time_step)) & (time <= time[-1] - EDGE * max(0.02, time_step))
        error = np.abs(motion.acceleration - np.sin(2 * np.pi * frequency * time + 0.7))
        assert error[inside].max() < 2 * RIPPLE


@pytest.mark.parametrize("part_of_nyquist", [1.0, 1.1, 1.25])
def test_any_coarser_time_step_does_not_fold_back(part_of_nyquist: float) -> None:
    time_step = 0.02 * np.sqrt(1.7)
    frequency = part_of_nyquist * 0.5 / time_step
    motion = interpolate(motion_of(np.sin(2 * np.pi * frequency * 0.02 * np.arange(900) + 0.7)), time_step)
    assert np.max(np.abs(motion.acceleration[EDGE : -EDGE - 1])) < RIPPLE


@given(record=RECORDS, ratio=RATIOS, coarser=st.booleans())
def test_any_time_step_is_resampling_where_that_is_possible(record: FloatArray, ratio: int, coarser: bool) -> None:
    record = np.append(record, np.zeros(ratio))
    time_step = 0.02 * ratio if coarser else 0.02 / ratio
    expected = resample(motion_of(record), time_step)
    found = interpolate(motion_of(record), time_step)
    np.testing.assert_allclose(found.acceleration, expected.acceleration, atol=1e-7)


def test_any_time_step_agrees_with_fourier_interpolation() -> None:
    record = band_limited_el_centro(0.85)
    points = round(record.size * 2.3)  # 1952 points become 4490
    time_step = 0.02 * record.size / points
    found = interpolate(motion_of(record), time_step).acceleration
    fourier = scipy.signal.resample(record, points)[: found.size]
    assert np.max(np.abs(found - fourier)) < 2 * RIPPLE * np.max(np.abs(record))


@pytest.mark.parametrize("time_step", [0.02 * 500.1, 0.02 / 500.1])
def test_a_time_step_of_another_unit_is_refused(time_step: float) -> None:
    with pytest.raises(InputError, match=r"has 0\.02 s, and a factor of at most 500 is required"):
        interpolate(motion_of(np.ones(5)), time_step)


# ---------------------------------------------------------------------------------------------- both directions


@pytest.mark.slow
@given(record=RECORDS, ratio=RATIOS)
def test_a_reversed_record_gives_the_reversed_result(record: FloatArray, ratio: int) -> None:
    forwards = resample(motion_of(record), 0.02 / ratio).acceleration
    backwards = resample(motion_of(record[::-1]), 0.02 / ratio).acceleration
    np.testing.assert_allclose(backwards[::-1], forwards, atol=1e-12)


@pytest.mark.slow
@given(record=RECORDS, other=st.floats(-3.0, 3.0), ratio=RATIOS, coarser=st.booleans())
def test_resampling_is_linear(record: FloatArray, other: float, ratio: int, coarser: bool) -> None:
    record = np.append(record, np.zeros(ratio))
    time_step = 0.02 * ratio if coarser else 0.02 / ratio
    mixed = resample(motion_of(other * record + record[::-1]), time_step).acceleration
    parts = (resample(motion_of(part), time_step).acceleration for part in (record, record[::-1]))
    np.testing.assert_allclose(mixed, other * next(parts) + next(parts), atol=1e-11)


@given(record=RECORDS, rest=st.integers(1, 40), ratio=RATIOS, coarser=st.booleans())
def test_a_later_record_gives_a_later_result(record: FloatArray, rest: int, ratio: int, coarser: bool) -> None:
    record = np.append(record, np.zeros(ratio))
    time_step, before = (0.02 * ratio, rest * ratio) if coarser else (0.02 / ratio, rest)
    shift = rest if coarser else rest * ratio
    early = resample(motion_of(record), time_step).acceleration
    late = resample(motion_of(np.append(np.zeros(before), record)), time_step).acceleration
    np.testing.assert_allclose(late[shift:], early, atol=1e-12)


def test_finer_and_back_is_the_record_again() -> None:
    record = band_limited_el_centro(0.8)
    back = resample(resample(motion_of(record), 0.005), 0.02)
    assert back.time_step == 0.02
    assert np.max(np.abs(back.acceleration - record)) < 2 * RIPPLE * np.max(np.abs(record))


def test_el_centro_at_the_time_step_of_the_loop() -> None:
    motion = read_ground_motion("el_centro_1940_ns")
    finer = resample(motion, 1 / 200)
    assert (finer.steps, finer.duration) == (6237, pytest.approx(motion.duration))
    assert (finer.name, finer.source, finer.sha256) == (motion.name, motion.source, motion.sha256)
    assert motion.peak <= finer.peak < 1.1 * motion.peak


@pytest.mark.parametrize("time_step", [0.02, 0.02 * (1 + 5e-10)])
def test_the_same_time_step_changes_no_point(time_step: float) -> None:
    motion = read_ground_motion("el_centro_1940_ns")
    same = resample(motion, time_step)
    np.testing.assert_array_equal(same.acceleration, motion.acceleration)
    assert same.time_step == time_step


@pytest.mark.parametrize("time_step", [0.03, 0.015, 0.02 / 3.5, 0.02 * (1 + 1e-8), 1e-6, 5e-324, 20.0, 1e300])
def test_time_steps_that_do_not_divide_each_other_are_refused(time_step: float) -> None:
    with pytest.raises(InputError) as caught:
        resample(motion_of(np.ones(5)), time_step)
    assert str(caught.value) == (
        f"time step {time_step:.9g} s; ground motion 'test' has 0.02 s, and a whole multiple or a whole fraction of "
        "that is required, by a factor of at most 500, or ground_motion.resample=true for band-limited interpolation"
    )


@pytest.mark.parametrize("time_step", [0.0, -0.01, float("nan"), float("inf")])
def test_bad_time_step_is_refused(time_step: float) -> None:
    with pytest.raises(InputError, match=rf"^time step {time_step:g} s; a finite number > 0 is required$"):
        resample(motion_of(np.ones(5)), time_step)


# ------------------------------------------------------------------------------------------- strength and length


@given(record=RECORDS.filter(lambda record: np.max(np.abs(record)) > 1e-6), peak=st.floats(1e-3, 50.0))
def test_scaled_record_has_the_peak_and_the_shape(record: FloatArray, peak: float) -> None:
    motion = motion_of(record)
    scaled = scale_to_peak(motion, peak)
    assert scaled.peak == peak
    np.testing.assert_allclose(scaled.acceleration, record * peak / motion.peak, rtol=1e-12, atol=1e-300)


def test_zero_record_cannot_be_scaled() -> None:
    with pytest.raises(InputError, match="'test': zero throughout, cannot be scaled to a peak of 2 m/s²"):
        scale_to_peak(motion_of(np.zeros(5)), 2.0)


@pytest.mark.parametrize("peak", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_peak_is_refused(peak: float) -> None:
    with pytest.raises(InputError, match=rf"^peak {peak:g} m/s²; a finite number > 0 is required$"):
        scale_to_peak(motion_of(np.ones(5)), peak)


@pytest.mark.parametrize(("duration", "zeros"), [(0.1, 0), (0.1 + 1e-12, 0), (0.3, 2), (0.31, 3), (0.6, 5), (0.7, 6)])
def test_pad_appends_rest(duration: float, zeros: int) -> None:
    padded = pad(motion_of(np.array([1.0, 2.0]), 0.1), duration)
    np.testing.assert_array_equal(padded.acceleration, [1.0, 2.0] + [0.0] * zeros)


@given(steps=st.integers(2, 20_000), time_step=st.sampled_from([0.02, 0.01, 0.005, 1 / 256, 1 / 3000]))
def test_a_record_has_its_own_duration(steps: int, time_step: float) -> None:
    motion = motion_of(np.ones(steps), time_step)
    assert pad(motion, motion.duration).steps == steps
    assert truncate(motion, motion.duration).steps == steps


def test_pad_to_less_than_the_record_is_refused() -> None:
    with pytest.raises(InputError, match=r"^duration 0\.2 s; ground motion 'test' can be padded to 0\.4 s or more$"):
        pad(motion_of(np.ones(5), 0.1), 0.2)


@pytest.mark.parametrize(("duration", "steps"), [(0.1, 2), (0.3, 4), (0.39, 4), (0.6, 7), (0.7, 8)])
def test_truncate_keeps_the_beginning(duration: float, steps: int) -> None:
    record = np.arange(8.0)
    np.testing.assert_array_equal(truncate(motion_of(record, 0.1), duration).acceleration, record[:steps])


@pytest.mark.parametrize("duration", [0.09, 0.8, 1e300])
def test_truncate_outside_the_record_is_refused(duration: float) -> None:
    with pytest.raises(InputError, match=r"'test' can be cut at 0\.1 s to 0\.7 s$"):
        truncate(motion_of(np.arange(8.0), 0.1), duration)


@pytest.mark.parametrize("change", [pad, truncate])
@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_duration_is_refused(change: Callable[[GroundMotion, float], GroundMotion], duration: float) -> None:
    with pytest.raises(InputError, match=rf"^duration {duration:g} s; a finite number > 0 is required$"):
        change(motion_of(np.ones(5)), duration)


def test_faded_record_begins_at_zero_smoothly_and_is_itself_afterwards() -> None:
    """The raised cosine at a sixth, a third and a half of its time: (1 - cos(30, 60, 90 deg)) / 2."""
    faded = fade_in(motion_of(np.full(20, -4.0), 0.1), 0.6).acceleration
    share = [0.0, 0.5 - np.sqrt(3) / 4, 0.25, 0.5, 0.75, 0.5 + np.sqrt(3) / 4]
    np.testing.assert_allclose(faded[:6], -4.0 * np.array(share), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(faded[6:], -4.0)


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_bad_fade_in_is_refused(duration: float) -> None:
    with pytest.raises(InputError, match=rf"^fade-in {duration:g} s; a finite number > 0 is required$"):
        fade_in(motion_of(np.ones(5)), duration)


def test_fade_in_longer_than_the_record_is_refused() -> None:
    with pytest.raises(InputError, match=r"^fade-in 0\.5 s; ground motion 'test' can be faded in over up to 0\.4 s$"):
        fade_in(motion_of(np.ones(5), 0.1), 0.5)


def test_selected_motion_is_faded_in_and_then_scaled_to_its_peak() -> None:
    whole = select_ground_motion(GroundMotionConfig(peak_acceleration=1.5), 0.005)
    faded = select_ground_motion(GroundMotionConfig(peak_acceleration=1.5, fade_in=4.0), 0.005)
    assert faded.peak == 1.5
    share = np.ones(whole.steps)
    share[:800] = np.sin(np.pi * np.arange(800) / 1600) ** 2
    expected = share * whole.acceleration
    np.testing.assert_allclose(faded.acceleration, expected * 1.5 / np.abs(expected).max(), rtol=0, atol=1e-12)
