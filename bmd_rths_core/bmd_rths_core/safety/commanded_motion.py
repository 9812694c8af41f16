"""The motion that the commands ask for, and the way it can still be stopped."""

from __future__ import annotations

import math
from typing import NamedTuple

from bmd_rths_core.safety.config import SafetyConfig

#: A sum of displacement [m], velocity [m/s] and acceleration [m/s²] that no table reaches.
LARGEST_MOTION = 1000.0


class Motion(NamedTuple):
    """Displacement, velocity and acceleration at the end of a step.

    Parameters
    ----------
    displacement : float
        [m].
    velocity : float
        [m/s].
    acceleration : float
        The command that was held until now [m/s²].
    """

    displacement: float
    velocity: float
    acceleration: float

    @property
    def plausible(self) -> bool:
        """False when no table moves like this, and a way to rest would have no end."""
        return abs(self.displacement) + abs(self.velocity) + abs(self.acceleration) <= LARGEST_MOTION

    def after(self, acceleration: float, duration: float) -> Motion:
        """Return the motion after a command was held: exact for any duration.

        Parameters
        ----------
        acceleration : float
            The command [m/s²].
        duration : float
            How long it is held [s].
        """
        change = acceleration * duration
        return Motion(
            self.displacement + duration * (self.velocity + 0.5 * change), self.velocity + change, acceleration
        )


#: At rest at zero displacement.
REST = Motion(0.0, 0.0, 0.0)


class StoppingRange(NamedTuple):
    """What a table passes through until it is at rest.

    Parameters
    ----------
    lowest, highest : float
        Displacements [m].
    velocity : float
        Largest absolute velocity [m/s].
    """

    lowest: float
    highest: float
    velocity: float


def stopping_range(motion: Motion, config: SafetyConfig, time_step: float) -> StoppingRange:
    """Return the range of displacement and velocity of the braking of `bmd_rths_core.safety.ramp.stop_commands`.

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
    StoppingRange
        Infinite for a motion that is not plausible.

    Notes
    -----
    Closed form: while the acceleration falls linearly to zero within n steps of total length t, v changes by
    a t (n − 1) / 2 n; then a raised cosine of length T takes v away over the distance v T / 2.
    """
    if not motion.plausible:
        return StoppingRange(-math.inf, math.inf, math.inf)
    displacement, velocity, acceleration = motion
    steps = unwinding_steps(acceleration, config, time_step)
    # Σ and ΣΣ of the held accelerations a (1 − j / n), j = 1 to n.
    duration = steps * time_step
    end_velocity = velocity + 0.5 * acceleration * time_step * (steps - 1)
    end = displacement + duration * velocity + acceleration * time_step**2 * (steps - 1) * (4 * steps + 1) / 12.0
    rest = end + 0.5 * end_velocity * braking_steps(end_velocity, config, time_step) * time_step
    lowest, highest = min(displacement, rest), max(displacement, rest)
    if velocity * end_velocity < 0.0:  # it turns while the acceleration falls: no farther than at that velocity
        turn = displacement + velocity * duration
        lowest, highest = min(lowest, turn), max(highest, turn)
    return StoppingRange(lowest, highest, max(abs(velocity), abs(end_velocity)))


def unwinding_steps(acceleration: float, config: SafetyConfig, time_step: float) -> int:
    """Return the steps in which an acceleration falls to zero with limited jerk; at least 1.

    Parameters
    ----------
    acceleration : float
        [m/s²].
    config : SafetyConfig
        With the jerk.
    time_step : float
        Δt [s].
    """
    return max(1, whole_steps(abs(acceleration) / config.ramp_jerk, time_step))


def braking_steps(velocity: float, config: SafetyConfig, time_step: float) -> int:
    """Return the steps in which a velocity is taken away with limited acceleration and jerk; 0 or at least 2.

    Parameters
    ----------
    velocity : float
        [m/s].
    config : SafetyConfig
        With acceleration and jerk.
    time_step : float
        Δt [s].

    Notes
    -----
    A raised cosine of duration T has the mean v / T, the peak 2 v / T and the jerk 2 π v / T².
    """
    speed = abs(velocity)
    if speed == 0.0:
        return 0
    duration = max(2.0 * speed / config.braking_acceleration, math.sqrt(2.0 * math.pi * speed / config.ramp_jerk))
    return max(2, whole_steps(duration, time_step))


def whole_steps(duration: float, time_step: float) -> int:
    """Return the steps that take at least a duration.

    Parameters
    ----------
    duration, time_step : float
        [s].

    Notes
    -----
    What is a whole number but for rounding stays that number: prediction and way to rest have to agree.
    """
    return math.ceil(duration / time_step * (1.0 - 1e-10))
