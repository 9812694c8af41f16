"""The ground motion as it will be run: how much it is scaled, and its peaks before and after."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.ground_motion.config import GroundMotionConfig, prepare_ground_motion, read_configured
from bmd_rths_core.ground_motion.motion import GroundMotion


@dataclass(frozen=True)
class GroundPeaks:
    """Peaks of a ground motion, integrated from rest without any correction.

    Parameters
    ----------
    acceleration, velocity, displacement : float
        PGA [m/s²], PGV [m/s], PGD [m].
    last_velocity, last_displacement : float
        What is left at the end [m/s, m]: the baseline. A record that has been corrected ends near rest.
    """

    acceleration: float
    velocity: float
    displacement: float
    last_velocity: float
    last_displacement: float


@dataclass(frozen=True)
class MotionAsRun:
    """A ground motion as the loop gets it.

    Parameters
    ----------
    motion : GroundMotion
        One sample a step.
    scale_factor : float
        Its accelerations over those of the record.
    recorded : GroundPeaks
        The record on the time axis of the loop, before it is scaled.
    scaled : GroundPeaks
        What the loop gets.
    """

    motion: GroundMotion
    scale_factor: float
    recorded: GroundPeaks
    scaled: GroundPeaks


def ground_motion_as_run(config: GroundMotionConfig, time_step: float) -> MotionAsRun:
    """Return the ground motion of a configuration as it will be run.

    Parameters
    ----------
    config : GroundMotionConfig
        What is asked for.
    time_step : float
        Δt of the loop [s].

    Returns
    -------
    MotionAsRun

    Raises
    ------
    InputError
        See `bmd_rths_core.ground_motion.config.select_ground_motion`.
    """
    return as_run(read_configured(config), config, time_step)


def as_run(record: GroundMotion, config: GroundMotionConfig, time_step: float) -> MotionAsRun:
    """Return a record that has been read as it will be run.

    Parameters
    ----------
    record : GroundMotion
        The record.
    config : GroundMotionConfig
        How it is scaled.
    time_step : float
        Δt of the loop [s].

    Raises
    ------
    InputError
        See `bmd_rths_core.ground_motion.config.prepare_ground_motion`.
    """
    unscaled = prepare_ground_motion(record, dataclasses.replace(config, peak_acceleration=0.0), time_step)
    motion = prepare_ground_motion(record, config, time_step)
    factor = motion.peak / unscaled.peak if unscaled.peak > 0.0 else 1.0
    return MotionAsRun(motion, factor, peaks_of(unscaled), peaks_of(motion))


def peaks_of(motion: GroundMotion) -> GroundPeaks:
    """Return the peaks of a ground motion by the trapezoidal rule, from rest.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    """
    velocity = _integral(motion.acceleration, motion.time_step)
    displacement = _integral(velocity, motion.time_step)
    last = float(velocity[-1]), float(displacement[-1])
    return GroundPeaks(motion.peak, float(np.max(np.abs(velocity))), float(np.max(np.abs(displacement))), *last)


def in_words(ran: MotionAsRun) -> str:
    """Return the line that tells a person how a record is scaled.

    Parameters
    ----------
    ran : MotionAsRun
        The ground motion.
    """
    before, after = ran.recorded, ran.scaled
    if abs(ran.scale_factor - 1.0) < 1e-9:
        scaled = f"as recorded, PGA {after.acceleration:.3g} m/s²"
    else:
        scaled = f"scaled by {ran.scale_factor:.4g}: PGA {before.acceleration:.3g} to {after.acceleration:.3g} m/s²"
    return (
        f"ground motion {ran.motion.name} {scaled}, PGV {after.velocity:.3g} m/s, PGD {1e3 * after.displacement:.3g} mm"
    )


def _integral(values: NDArray[np.float64], time_step: float) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(values[1:] + values[:-1])]) * (time_step / 2.0)
