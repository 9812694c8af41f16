"""Bring the table to rest: held acceleration commands that leave neither velocity nor displacement.

Three parts, one after the other. *Unwind*: the acceleration falls linearly to zero. *Brake*: a raised cosine takes the
velocity away; here a hold ends. *Return*: a cycloidal motion takes the displacement away. The parts are scaled in
discrete time with the commands held over the steps, so that what is left is rounding. The last command is zero, so
that a table that holds it stays at rest.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.safety.commanded_motion import Motion, braking_steps, unwinding_steps, whole_steps
from bmd_rths_core.safety.config import SafetyConfig

FloatArray = NDArray[np.float64]


def stop_commands(motion: Motion, config: SafetyConfig, time_step: float) -> FloatArray:
    """Return the commands that bring the table to rest where it is.

    Parameters
    ----------
    motion : Motion
        The motion from which the table is braked.
    config : SafetyConfig
        Acceleration and jerk of the braking.
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray, shape (N,)
        Acceleration commands [m/s²], each to be held for one step. Jerk is the change from one step to the next over
        Δt, the first from the last command.
    """
    steps = unwinding_steps(motion.acceleration, config, time_step)
    unwind = motion.acceleration * (1.0 - np.arange(1, steps + 1) / steps)
    velocity = _after(motion, unwind, time_step).velocity
    return np.concatenate((unwind, _brake(velocity, config, time_step), [0.0]))


def ramp_commands(motion: Motion, config: SafetyConfig, time_step: float) -> FloatArray:
    """Return the commands that bring the table to rest at zero displacement.

    Parameters
    ----------
    motion : Motion
        The motion from which the table is braked.
    config : SafetyConfig
        Acceleration, jerk and velocity of the ramp.
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray, shape (N,)
        Acceleration commands [m/s²], as those of `stop_commands`.
    """
    stop = stop_commands(motion, config, time_step)
    displacement = _after(motion, stop, time_step).displacement
    return np.concatenate((stop, _return(displacement, config, time_step), [0.0]))


def longest_ramp(config: SafetyConfig, time_step: float) -> float:
    """Return the longest time a ramp to rest takes from a motion that keeps the limits.

    Parameters
    ----------
    config : SafetyConfig
        Limits and ramp.
    time_step : float
        Δt [s].

    Returns
    -------
    float
        Ramp time [s].
    """
    steps = unwinding_steps(config.acceleration_limit, config, time_step)
    steps += braking_steps(config.velocity_limit, config, time_step)
    return time_step * (steps + _returning_steps(config.displacement_limit, config, time_step) + 2)


def _brake(velocity: float, config: SafetyConfig, time_step: float) -> FloatArray:
    steps = braking_steps(velocity, config, time_step)
    shape = 1.0 - np.cos(2.0 * math.pi * (np.arange(steps) + 0.5) / max(steps, 1))
    return -velocity * shape / (max(steps, 1) * time_step)  # the shape has the sum `steps`


def _return(displacement: float, config: SafetyConfig, time_step: float) -> FloatArray:
    steps = _returning_steps(displacement, config, time_step)
    if steps == 0:
        return np.zeros(0)
    position = np.arange(steps) + 0.5
    shape = np.sin(2.0 * math.pi * position / steps)
    # A command held in step k moves the table by (N − k − 1/2) Δt² of itself until the end.
    distance = float((steps - position) @ shape) * time_step**2
    return -displacement / distance * shape


def _returning_steps(displacement: float, config: SafetyConfig, time_step: float) -> int:
    """Return the steps of a cycloidal motion: peaks 2 d / T, 2 π d / T² and 4 π² d / T³."""
    distance = abs(displacement)
    if distance == 0.0:
        return 0
    duration = max(
        2.0 * distance / config.ramp_velocity,
        math.sqrt(2.0 * math.pi * distance / config.braking_acceleration),
        math.pow(4.0 * math.pi**2 * distance / config.ramp_jerk, 1.0 / 3.0),
    )
    return max(4, whole_steps(duration, time_step) + 1)


def _after(motion: Motion, commands: FloatArray, time_step: float) -> Motion:
    for command in commands.tolist():
        motion = motion.after(command, time_step)
    return motion
