"""The limits of many runs at once: whether one could have been passed, and the supervisor over those where it could.

The screen is an array operation on the safe side of every limit. Where it sees nothing there is nothing; where it sees
something, the real supervisor and the real stability indicator go through the signals step by step and decide, in the
order of `RthsLoop`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.indicator_screen import IndicatorScreen, running_mean
from bmd_rths_core.config import Config
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.build import make_stability_indicator, make_supervisor
from bmd_rths_core.safety import Action, SafetySupervisor, StabilityIndicator
from bmd_rths_core.safety.commanded_motion import LARGEST_MOTION, Motion
from bmd_rths_core.safety.supervisor import OFFSET_TIME
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import most_steps

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: Part of a limit from which it counts as reached: more than rounding makes of any signal.
_NEAR = 1.0 - 1e-8
#: Limits with a value that a run in process can pass.
_LIMITS = ("displacement", "velocity", "acceleration", "increment", "force", "tracking", "stability")
_MEASURED = ("command", "table_displacement", "table_acceleration", "actuator_force", "base_shear")
#: Signals of a `SignalChunk`.
SCREENED = (*_MEASURED, "corrected_force")


class LimitEnd(NamedTuple):
    """How a limit ended a run.

    Parameters
    ----------
    steps : int
        How many steps were recorded.
    measured : int
        How many of them were measured: one less where a command was refused.
    reason : str
        Text that names the limit.
    """

    steps: int
    measured: int
    reason: str


class SignalChunk(NamedTuple):
    """Some steps of m runs, beginning at the same step.

    Parameters
    ----------
    begin : int
        The first step.
    lengths : ndarray of int, shape (m,)
        How many of the N steps belong to each run; what follows does not count.
    signals : Mapping of str to ndarray, shape (m, N)
        By the names of `RunRecord`.
    floors : ndarray, shape (m, n, N)
        Accelerations of the floors on the table [m/s²].
    displacements : ndarray, shape (m, n, N)
        Of the numerical substructure [m].
    """

    begin: int
    lengths: NDArray[np.intp]
    signals: Mapping[str, FloatArray]
    floors: FloatArray
    displacements: FloatArray


class LimitScreen:
    """Find the runs that a limit ends.

    Parameters
    ----------
    config : Config
        The configuration of all of them.
    runs : int
        Number of runs m.
    """

    def __init__(self, config: Config, runs: int) -> None:
        self._config, self._safety, self._time_step = config, config.safety, config.run.time_step
        self._ending = {name for name in _LIMITS if config.safety.action(name) > Action.INDICATE}
        step = self._time_step
        transition, held = np.array([[1.0, step], [0.0, 1.0]]), np.array([[0.5 * step**2], [step]])
        self._motion = LinearSimulation(DiscreteStateSpace(transition, held, transition, held), np.zeros((2, runs)))
        self._offset = running_mean(step, OFFSET_TIME, runs)
        self._tracking = running_mean(step, self._safety.tracking_time, runs)
        self._last_command = np.zeros((runs, 1))
        # Where the commands had led the table, for whether it follows them: as the supervisor remembers it.
        self._past = np.zeros((runs, 1 + most_steps(self._safety.following_time, step)))
        self._indicator = IndicatorScreen(config, runs)

    def keep(self, runs: BoolArray) -> None:
        """Go on with some of the runs only.

        Parameters
        ----------
        runs : ndarray of bool, shape (m,)
            True for those that go on.
        """
        for part in (self._motion, self._offset, self._tracking, self._indicator):
            part.keep(runs)
        self._last_command, self._past = self._last_command[runs], self._past[runs]

    def ends(self, chunk: SignalChunk) -> dict[int, LimitEnd]:
        """Look at the next steps.

        Parameters
        ----------
        chunk : SignalChunk
            They follow those of the last call.

        Returns
        -------
        dict of int to LimitEnd
            Which runs end in them, and how.
        """
        before = self._state()
        with np.errstate(over="ignore", invalid="ignore"):
            largest = self._largest(chunk)
            below = [largest[name] <= getattr(self._safety, f"{name}_limit") * _NEAR for name in self._ending]
            finite = [np.isfinite(signal).all(axis=-1) for signal in chunk.signals.values()]
            kept = np.logical_and.reduce([*below, *finite])
        ends = {}
        for i in np.flatnonzero(~kept).tolist():
            end = _replay(chunk, i, *self._taken_up(before, i, chunk.begin))
            if end is not None:
                ends[i] = end
        return ends

    def _largest(self, chunk: SignalChunk) -> dict[str, FloatArray]:
        """Return the largest value of every run that each limit could see."""
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
        self._past = np.hstack((self._past, displacement))[:, -self._past.shape[1] :]
        return {name: value.max(axis=-1) for name, value in values.items()}

    def _until_rest(self, velocity: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return bounds of velocity and travel until the table is at rest, for absolute velocity and acceleration.

        Bounds of `stopping_range`: whole steps are at most one more than their duration, and no signs are used.
        """
        safety, step = self._safety, self._time_step
        unwinding = acceleration / safety.ramp_jerk
        speed = velocity + 0.5 * acceleration * unwinding
        braking = np.maximum(2.0 * speed / safety.ramp_acceleration, np.sqrt(2.0 * np.pi * speed / safety.ramp_jerk))
        return speed, speed * (unwinding + step + 0.5 * np.maximum(braking + step, 2.0 * step))

    def _state(self) -> tuple[FloatArray, ...]:
        """Return what the supervisor knows of every run before the next step."""
        own = (self._motion.state, self._last_command.T, self._offset.state, self._tracking.state, self._past)
        return (*own, *self._indicator.state())

    def _taken_up(
        self, state: tuple[FloatArray, ...], i: int, step: int
    ) -> tuple[SafetySupervisor, StabilityIndicator, float]:
        """Return supervisor and indicator in the state of a run, and the shear that was fed back last."""
        motion, command, offset, tracking, past, displacements, forces, power, energy, value = state
        supervisor, indicator = make_supervisor(self._config), make_stability_indicator(self._config)
        if step:
            displacement, velocity = motion[:, i].tolist()
            now = Motion(displacement, velocity, float(command[0, i]))
            supervisor.resume(step, now, float(offset[0, i]), float(tracking[0, i]), past[i, :-1].tolist())
            acted = forces[i].tolist()
            indicator.resume(displacements[i], acted[:3], float(power[0, i]), float(energy[0, i]))
            indicator.value = float(value[i, 0])
        return supervisor, indicator, float(forces[i, -1])


def _replay(
    chunk: SignalChunk, i: int, supervisor: SafetySupervisor, indicator: StabilityIndicator, feedback: float
) -> LimitEnd | None:
    """Go through a run step by step, in the order of `RthsLoop`."""
    length = chunk.lengths[i]
    columns = [chunk.signals[name][i, :length].tolist() for name in _MEASURED]
    corrected = chunk.signals["corrected_force"][i].tolist()
    for k, (command, displacement, acceleration, force, shear) in enumerate(zip(*columns, strict=True)):
        step = chunk.begin + k
        unstable = indicator.step(step, feedback, chunk.displacements[i, :, k])
        if unstable is not None:
            supervisor.record([unstable])
            if supervisor.reason:
                return LimitEnd(step, step, supervisor.reason)
        if not supervisor.check(step, command):
            return LimitEnd(step + 1, step, supervisor.reason)
        floors = chunk.floors[i, :, k]
        supervisor.observe(TableMeasurement(step, command, displacement, acceleration, force, shear, floors))
        feedback = corrected[k]
    return None
