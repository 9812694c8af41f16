"""The way to rest while it is gone: planned, planned anew where the table has strayed, corrected at its end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.safety.commanded_motion import REST, Motion
from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.ramp import longest_ramp, ramp_commands
from bmd_rths_core.safety.settling import Settling

#: A table that is slower and nearer than this is at rest at zero displacement [m/s, m].
SETTLED_VELOCITY = 2e-5
SETTLED_DISPLACEMENT = 2e-5

#: What commands that were not held for just Δt leave at the end is taken away by further ways to rest, gentle ones so
#: that they leave less. So many are tried; each leaves about a hundredth of what it takes away, and up to all of it
#: where the commands come up to half a step late, again and again in the same order.
MOST_CORRECTIONS = 20
#: None for little is begun later than this after the table was first watched [s]: nobody waits for it for ever.
CORRECTION_TIME = 8.0
_GENTLE = {"ramp_acceleration": 0.5, "ramp_jerk": 50.0}
#: A busy computer leaves as much of what little there is as it takes away, unless the way is gentler still.
_GENTLER = {"ramp_acceleration": 0.05, "ramp_jerk": 5.0}
_LITTLE_VELOCITY, _LITTLE_DISPLACEMENT = 0.01, 0.005  # m/s, m
#: A busy computer leaves no more than this after a gentle way, as `_size` has it [m].
_MOST_BY_A_BUSY_COMPUTER = 0.02

#: Longest hold of a command on the way of a host that is late again and again [s], below the watchdog of a controller.
LONGEST_HOLD = 0.02
#: A host may be held up so often on the way before its commands are held for longer than Δt.
STALLS = 1
#: A host whose plans have led astray more often than this gives up: the controller of the table has a better clock.
MOST_STRAYS = 10

#: `stop_commands` or `ramp_commands`.
Planner = Callable[[Motion, SafetyConfig, float], NDArray[np.float64]]


def longest_way_to_rest(config: SafetyConfig, time_step: float) -> float:
    """Return how long a host waits for a table to come to rest [s]: two ramps, one planned anew, and the corrections.

    Parameters
    ----------
    config : SafetyConfig
        Acceleration, jerk and velocity of the way.
    time_step : float
        Δt [s].
    """
    ramp = longest_ramp(config, time_step)
    return 2.0 * ramp + CORRECTION_TIME + min(ramp, CORRECTION_TIME)


class WayToRest:
    """The commands that bring the table to rest.

    Parameters
    ----------
    config : SafetyConfig
        Acceleration, jerk and velocity of the way.
    time_step : float
        Δt [s].

    Attributes
    ----------
    hold : float
        For how long the next command is to be held [s]: Δt, and longer for a host that could not keep that.
    led_away : tuple of Motion, or None
        What was seen before and after a way back that made it larger: the sensor has a wrong sign or scale.
    """

    def __init__(self, config: SafetyConfig, time_step: float) -> None:
        self._config = config
        self._gentle, self._gentler = (
            replace(config, **{name: min(getattr(config, name), most) for name, most in limits.items()})
            for limits in (_GENTLE, _GENTLER)
        )
        self._time_step = time_step
        self._settling = Settling(time_step)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._plan: list[float] | None = None
        self.hold, self._strays = self._time_step, 0
        self._planned = REST
        self._corrections = 0
        self._found: Motion | None = None
        self._made_worse = 0
        self.led_away: tuple[Motion, Motion] | None = None
        self._watched_from = self._watched_until = -1
        self._settling.reset()

    @property
    def begun(self) -> bool:
        """True from the first plan until `abandon`."""
        return self._plan is not None

    @property
    def given_up(self) -> bool:
        """True when commands were late so often that no plan has led to rest: the table controller has to."""
        return self._strays > MOST_STRAYS

    def ended(self, motion: Motion, planner: Planner) -> bool:
        """Tell whether all commands were given, and no further way is to follow.

        Parameters
        ----------
        motion : Motion
            The motion of the table now.
        planner : callable
            Makes the commands.
        """
        return self._plan == [] and not self._correctable(motion, planner)

    def abandon(self) -> None:
        """Drop the plan; the next way begins with a new one."""
        self._plan = None

    def observe(self, step: int, displacement: float) -> None:
        """Take a measured displacement.

        Parameters
        ----------
        step : int
            Step of the measurement.
        displacement : float
            Displacement of the table [m].
        """
        self._settling.observe(step, displacement)

    def next(self, motion: Motion, planner: Planner | None) -> float | None:
        """Return the next command, after planning where that is needed.

        Parameters
        ----------
        motion : Motion
            The motion of the table now.
        planner : callable or None
            Makes the commands; None when there are none to be made.

        Returns
        -------
        float or None
            Acceleration command [m/s²]; None at the end of the way.
        """
        if self._plan is None or self._strayed(motion):
            if self._plan is not None:
                self._strays += 1
            if self._strays > STALLS:  # as late again, a plan like the last one would lead astray again, without end
                self.hold = max(self.hold, min(2.0 * self.hold, LONGEST_HOLD))
            self._begin(motion, None if self.given_up else planner, self._config)
            self._corrections, self._watched_from, self._found, self._made_worse = 0, -1, None, 0
        elif not self._plan and self._correctable(motion, planner):
            self._begin(motion, planner, self._gently(motion))
            self._corrections += 1
        return self._pop()

    def watches(self, step: int) -> bool:
        """Tell whether the table is still to be watched at the end of the way, with zero acceleration.

        Parameters
        ----------
        step : int
            Step of the next command.
        """
        self._watched_from = step if self._watched_from < 0 else self._watched_from
        self._watched_until = step
        return self._settling.watches(step)

    def found(self) -> Motion | None:
        """End the watch, and return the motion that was seen where a further way is to take it away."""
        found = self._settling.found() if self._corrections < MOST_CORRECTIONS else None
        before, self._found = self._found, found
        if found is None or abs(found.displacement) > self._config.displacement_limit:
            return None
        worse = before is not None and not _is_little(found) and _size(found) >= _size(before)
        self._made_worse = self._made_worse + 1 if worse else 0
        if before is not None and worse and (self._made_worse > 1 or _size(found) > _MOST_BY_A_BUSY_COMPUTER):
            self.led_away = before, found
            return None
        in_time = (self._watched_until - self._watched_from) * self._time_step < CORRECTION_TIME
        return found if in_time or not _is_little(found) else None

    def correct(self, motion: Motion, planner: Planner) -> float | None:
        """Begin a gentle way from a motion that was seen, and return its first command.

        Parameters
        ----------
        motion : Motion
            The motion that was seen.
        planner : callable
            Makes the commands.

        Returns
        -------
        float or None
            Acceleration command [m/s²]; None when there is none.
        """
        self._begin(motion, planner, self._gently(motion))
        self._corrections += 1
        return self._pop()

    def _gently(self, motion: Motion) -> SafetyConfig:
        # A way that is gentler still tells a busy computer, which may have made it worse, from a wrong sensor.
        return self._gentler if _is_little(motion) or self._made_worse else self._gentle

    def _begin(self, motion: Motion, planner: Planner | None, config: SafetyConfig) -> None:
        """Plan the commands, the last one first."""
        self._plan = [] if planner is None else planner(motion, config, self.hold)[::-1].tolist()
        self._planned = motion

    def _pop(self) -> float | None:
        if not self._plan:
            return None
        command = self._plan.pop()
        self._planned = self._planned.after(command, self.hold)
        return command

    def _strayed(self, motion: Motion) -> bool:
        """Tell whether commands were held for so much longer or shorter that the plan does not lead to rest."""
        off = 0.5 * self._config.ramp_acceleration * self.hold
        return abs(motion.velocity - self._planned.velocity) > off

    def _correctable(self, motion: Motion, planner: Planner | None) -> bool:
        """Tell whether the table still moves, or stands off zero, because commands were not held for just Δt."""
        if planner is None or self._corrections >= MOST_CORRECTIONS:
            return False
        off = planner is ramp_commands and abs(motion.displacement) > SETTLED_DISPLACEMENT
        return off or abs(motion.velocity) > SETTLED_VELOCITY


def _size(motion: Motion) -> float:
    """Return how far a table that goes on for a second is then from where it was to be, whichever way it goes [m]."""
    return abs(motion.displacement) + abs(motion.velocity)


def _is_little(motion: Motion) -> bool:
    return abs(motion.velocity) < _LITTLE_VELOCITY and abs(motion.displacement) < _LITTLE_DISPLACEMENT
