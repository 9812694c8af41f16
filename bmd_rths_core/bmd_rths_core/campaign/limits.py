"""Bounds of what the limits see of many runs at once: a run that touches none of them passes no limit.

Nothing is decided here. A run that touches a bound is run whole by `RthsLoop`, whose supervisor judges it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import LinearSimulation, running_mean
from bmd_rths_core.loop.build import make_stability_indicator_array
from bmd_rths_core.safety import Action
from bmd_rths_core.safety.commanded_motion import LARGEST_MOTION
from bmd_rths_core.safety.supervisor import OFFSET_TIME

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Part of a limit from which it counts as touched: more than rounding makes of any signal.
_NEAR = 1.0 - 1e-8
#: Limits with a value that a run in process can pass.
_LIMITS = ("displacement", "velocity", "acceleration", "increment", "force", "tracking", "stability")
#: Signals of a `SignalChunk`.
BOUNDED = (*("command", "table_displacement", "table_acceleration", "actuator_force", "base_shear", "corrected_force"),)


class SignalChunk(NamedTuple):
    """Some steps of m runs, beginning at the same step.

    Parameters
    ----------
    lengths : ndarray of int, shape (m,)
        How many of the N steps belong to each run; what follows does not count.
    signals : Mapping of str to ndarray, shape (m, N)
        Those of `BOUNDED`, by the names of `RunRecord`.
    displacements : ndarray, shape (m, n, N)
        Of the numerical substructure [m].
    """

    lengths: NDArray[np.intp]
    signals: Mapping[str, FloatArray]
    displacements: FloatArray


class LimitBounds:
    """Find the runs that could pass a limit.

    Parameters
    ----------
    config : Config
        The configuration of all of them.
    runs : int
        Number of runs m.
    """

    def __init__(self, config: Config, runs: int) -> None:
        self._safety, self._time_step = config.safety, config.run.time_step
        self._ending = {name for name in _LIMITS if config.safety.action(name) > Action.INDICATE}
        step = self._time_step
        transition, held = np.array([[1.0, step], [0.0, 1.0]]), np.array([[0.5 * step**2], [step]])
        self._motion = LinearSimulation(DiscreteStateSpace(transition, held, transition, held), np.zeros((2, runs)))
        self._offset = running_mean(step, OFFSET_TIME, runs)
        self._tracking = running_mean(step, self._safety.tracking_time, runs)
        self._last_command = np.zeros((runs, 1))
        self._indicator = make_stability_indicator_array(config, runs)

    def keep(self, runs: BoolArray) -> None:
        """Go on with some of the runs only.

        Parameters
        ----------
        runs : ndarray of bool, shape (m,)
            True for those that go on.
        """
        for part in (self._motion, self._offset, self._tracking, self._indicator):
            part.keep(runs)
        self._last_command = self._last_command[runs]

    def touched(self, chunk: SignalChunk) -> BoolArray:
        """Look at the next steps.

        Parameters
        ----------
        chunk : SignalChunk
            They follow those of the last call.

        Returns
        -------
        ndarray of bool, shape (m,)
            True for the runs that could pass a limit in them, or have a value that is not finite.
        """
        steps = chunk.displacements.shape[-1]
        inside = np.arange(steps) < chunk.lengths[:, None]
        with np.errstate(over="ignore", invalid="ignore"):
            seen = self._seen(chunk)
            below = [
                (seen[name] <= getattr(self._safety, f"{name}_limit") * _NEAR).all(axis=-1, where=inside)
                for name in self._ending
            ]
        finite = [np.isfinite(signal).all(axis=-1, where=inside) for signal in chunk.signals.values()]
        return np.asarray(~np.logical_and.reduce([*below, *finite]))

    def _seen(self, chunk: SignalChunk) -> dict[str, FloatArray]:
        """Return a bound of what each limit sees, (m, N)."""
        command, measured = chunk.signals["command"], chunk.signals["table_displacement"]
        last_offset = self._offset.state.T
        motion = self._motion.advance(command.T)
        displacement, velocity = motion[:, 0], motion[:, 1]
        offset = self._offset.advance((measured - displacement).T)[:, 0]
        # A command is judged with the offset of the step before.
        offset_before = np.hstack((last_offset, offset[:, :-1]))
        speed, travel = self._until_rest(np.abs(velocity), np.abs(command))
        plausible = np.abs(displacement) + np.abs(velocity) + np.abs(command) <= LARGEST_MOTION
        reach = np.maximum(np.abs(displacement + offset_before) + travel, np.abs(measured))
        error = command - chunk.signals["table_acceleration"]
        values = {
            "displacement": np.where(plausible, reach, np.inf),
            "velocity": np.where(plausible, speed, np.inf),
            "acceleration": np.abs(command),
            "increment": np.abs(np.diff(command, axis=-1, prepend=self._last_command)),
            "force": np.abs(chunk.signals["actuator_force"]),
            "tracking": np.sqrt(self._tracking.advance((error * error).T)[:, 0]),
            "stability": self._indicator.advance(chunk.signals["corrected_force"], chunk.displacements),
        }
        self._last_command = command[:, -1:]
        return values

    def _until_rest(self, velocity: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds of velocity and travel until the table is at rest, for absolute velocity and acceleration.

        Bounds of `stopping_range`: whole steps are at most one more than their duration, and no signs are used.
        """
        safety, step = self._safety, self._time_step
        unwinding = acceleration / safety.ramp_jerk
        speed = velocity + 0.5 * acceleration * unwinding
        longest = np.maximum(2.0 * speed / safety.braking_acceleration, np.sqrt(2.0 * np.pi * speed / safety.ramp_jerk))
        return speed, speed * (unwinding + step + 0.5 * np.maximum(longest + step, 2.0 * step))
