"""A fade-in together with a baseline correction."""

import dataclasses

import numpy as np

from bmd_rths_core.ground_motion import GroundMotion, fade_in, resample
from bmd_rths_core.ground_motion.config import GroundMotionConfig, prepare_ground_motion
from bmd_rths_core.ground_motion.processing import high_pass


def abrupt():
    """Return a record that begins with its peak, as one that was cut."""
    return GroundMotion("cut", 0.005, 2.0 * np.cos(3.0 * np.pi * np.arange(2001) * 0.005), "test", "0" * 64)


def test_fade_in_begins_the_record_and_not_the_rest_before_it_when_both_are_asked_for():
    frequency, duration = 0.25, 2.0
    asked = GroundMotionConfig(peak_acceleration=0.0, high_pass_frequency=frequency)
    plain = prepare_ground_motion(abrupt(), asked, 0.005).acceleration
    faded = prepare_ground_motion(abrupt(), dataclasses.replace(asked, fade_in=duration), 0.005).acceleration
    begin = round(3.0 / frequency / 0.005)
    assert len(faded) == len(plain)
    assert abs(plain[begin] - plain[begin - 1]) > 1.9  # the jump that a fade-in is there for
    assert (
        np.abs(np.diff(faded[: begin + 2001])).max() < 1.05 * 2.0 * (2.0 * np.pi * 1.5) * 0.005
    )  # no faster than the record itself
    assert np.abs(faded[: begin + 40]).max() < 0.1
    # Where the record is whole again only what is slower than the filter differs.
    after = slice(begin + round(duration / 0.005), begin + 2001)
    assert np.abs(faded[after] - plain[after]).max() < 0.1
    # The baseline is still corrected: no velocity and no displacement are left.
    velocity = 0.005 * np.cumsum(faded)
    assert abs(velocity[-1]) < 1e-3
    assert abs(0.005 * velocity.sum()) < 5e-3


def test_fade_in_with_a_high_pass_is_the_filtered_faded_record():
    asked = GroundMotionConfig(peak_acceleration=0.0, high_pass_frequency=0.25, fade_in=2.0)
    expected = resample(high_pass(fade_in(abrupt(), 2.0), 0.25), 0.0025)
    assert np.array_equal(prepare_ground_motion(abrupt(), asked, 0.0025).acceleration, expected.acceleration)
