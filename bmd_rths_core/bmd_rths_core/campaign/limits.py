"""Bounds of what the limits see of many runs at once: a run that touches none of them passes no limit.

Nothing is decided here. A run that touches a bound is run whole by `RthsLoop`, whose supervisor judges it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import LinearSimulation, running_mean
from bmd_rths_core.loop.build import make_stability_indicator_array
from bmd_rths_core.safety import Action
from bmd_rths_core.safety.commanded_motion import LARGEST_MOTION, Motion
from bmd_rths_core.safety.ramp import ramp_commands
from bmd_rths_core.safety.supervisor import OFFSET_TIME

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Part of a limit from which it counts as touched: more than rounding makes of any signal.
_NEAR = 1.0 - 1e-8
#: Limits with a value that a run in process can pass.
_LIMITS = ("displacement", "velocity", "acceleration", "increment", "force", "tracking", "stability")
#: Signals of sensors that have a limit on the way to rest too.
SENSED = ("table_displacement", "table_acceleration", "actuator_force")
#: Signals of a `SignalChunk`.
BOUNDED = ("command", *SENSED, "base_shear", "corrected_force")


class SignalChunk(NamedTuple):
    """Some steps of m runs, beginning at the same step.

    Parameters
    ----------
    signals : Mapping of str to ndarray, shape (m, N)
        Those of `BOUNDED`, by the names of `RunRecord`.
    displacements : ndarray, shape (m, n, N)
        Of the numerical substructure [m].
    """

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
        with np.errstate(over="ignore", invalid="ignore"):
            seen = self._seen(chunk)
        finite = [np.isfinite(signal).all(axis=-1) for signal in chunk.signals.values()]
        return np.asarray(~np.logical_and.reduce([*(self._below(name, seen[name]) for name in self._ending), *finite]))

    def ways_to_rest(self, runs: BoolArray) -> list[FloatArray]:
        """Return the commands that bring the table to rest after the steps so far, of some of the runs.

        Parameters
        ----------
        runs : ndarray of bool, shape (m,)
            True for those whose ground motion is at its end.
        """
        motions = np.vstack((self._motion.state, self._last_command.T))[:, runs].T.tolist()
        return [ramp_commands(Motion(*motion), self._safety, self._time_step) for motion in motions]

    def touched_on_the_way(
        self, runs: BoolArray, ways: Sequence[FloatArray], signals: Mapping[str, FloatArray]
    ) -> BoolArray:
        """Look at the ways to rest.

        Parameters
        ----------
        runs : ndarray of bool, shape (m,)
            As for `ways_to_rest`.
        ways : sequence of ndarray
            The m' ways that it has given.
        signals : Mapping of str to ndarray, shape (m', N)
            Those of `SENSED` meanwhile. N is at least the length of every way.

        Returns
        -------
        ndarray of bool, shape (m',)
            True for the runs that could pass a limit on their way.
        """
        error = in_rows(ways, signals["table_acceleration"].shape[1]) - signals["table_acceleration"]
        tracking = running_mean(self._time_step, self._safety.tracking_time, len(ways))
        tracking.state = self._tracking.state[:, runs]
        seen = {
            "displacement": np.abs(signals["table_displacement"]),
            "force": np.abs(signals["actuator_force"]),
            "tracking": np.sqrt(tracking.advance((error * error).T)[:, 0]),
        }
        on_the_way = np.arange(error.shape[1]) < np.array([len(way) for way in ways])[:, None]
        below = [self._below(name, seen[name], on_the_way) for name in seen if name in self._ending]
        return np.asarray(~np.logical_and.reduce([np.ones(len(ways), bool), *below]))

    def _below(self, name: str, seen: FloatArray, where: BoolArray | bool = True) -> BoolArray:
        limit: float = getattr(self._safety, f"{name}_limit")
        return np.asarray((seen <= limit * _NEAR).all(axis=-1, where=where))

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


def in_rows(ways: Sequence[FloatArray], steps: int) -> FloatArray:
    """Return the commands of ways to rest, a row each, with zeros after their ends.

    Parameters
    ----------
    ways : sequence of ndarray
        The m ways.
    steps : int
        Length of the rows N.

    Returns
    -------
    ndarray, shape (m, N)
    """
    return np.array([np.pad(way, (0, steps - len(way))) for way in ways])
