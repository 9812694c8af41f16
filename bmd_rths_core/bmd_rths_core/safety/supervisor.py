"""The supervisor in the path of the command: it passes a command on, replaces it by a ramp, or stops the table."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial

from bmd_rths_core.safety.commanded_motion import REST, Motion, stopping_range
from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.following import FollowingCheck
from bmd_rths_core.safety.measurement_check import MeasurementCheck
from bmd_rths_core.safety.ramp import ramp_commands, stop_commands
from bmd_rths_core.safety.state import SEVERITY, STATE_OF, State
from bmd_rths_core.safety.trips import Action, Trip
from bmd_rths_core.safety.way_to_rest import SETTLED_DISPLACEMENT, SETTLED_VELOCITY, Planner, WayToRest
from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.time_steps import most_steps

#: Time constant of the mean difference between measured and commanded displacement [s].
OFFSET_TIME = 1.0


class SafetySupervisor:
    """Check every command before it reaches the table, and every measurement after.

    Once a limit has been passed whose action is more than to indicate, no command is passed on until `reset`; nothing
    is ever clipped. The caller then goes on with `advance`, step by step, until the table is at rest.

    Parameters
    ----------
    config : SafetyConfig
        Limits and ramp.
    time_step : float
        Δt [s].

    Attributes
    ----------
    state : State
        What it does.
    by_the_clock : bool
        Commands are held by a clock, so that the table may end elsewhere than the sum of its commands: the way to rest
        then ends where the displacement sensor says that the table stands where it began.
    emergency : bool
        An emergency stop was asked for: the table is to be stopped by the fastest way it has.

    Notes
    -----
    Displacement and velocity are predicted by integrating the commands, exactly for held commands, plus the slow
    difference to the measured displacement where there is one. A command is refused when the table could no longer be
    brought to rest within displacement and velocity limit after it: as every command before passed this test, the
    braking that follows keeps the limits.
    """

    def __init__(self, config: SafetyConfig, time_step: float) -> None:
        self.by_the_clock = False
        self._config = config
        self._time_step = time_step
        self._measurement_check = MeasurementCheck(config, time_step)
        self._way = WayToRest(config, time_step)
        self._following = FollowingCheck(config, time_step)
        self._actions = {name: config.action(name) for name in _COMMAND_LIMITS}
        self._silent_steps = most_steps(config.stale_shear_time, time_step)
        self._unheard_steps = most_steps(config.stale_controller_time, time_step)
        self._offset_share = min(1.0, time_step / OFFSET_TIME)
        self.reset()

    def reset(self) -> None:
        """Arm for a new test: at rest at zero displacement, nothing tripped."""
        self.state = State.NORMAL
        self.emergency = False
        self._trips: list[Trip] = []
        self._latched: dict[str, Action] = {}
        self._motion = REST
        self._offset = 0.0
        self._last_step = -1
        self._last_measured = -1
        self._replaced = 0.0  # the acceleration that the last command has replaced
        self._way.reset()
        self._measurement_check.reset()
        self._following.reset()

    @property
    def trips(self) -> tuple[Trip, ...]:
        """Every limit that was passed since the last reset, once, in the order of time."""
        return tuple(self._trips)

    @property
    def reason(self) -> str:
        """The trip that stops the test, in words; empty when there is none."""
        stopping = [trip for trip in self._trips if trip.action > Action.INDICATE]
        return str(stopping[0]) if stopping else ""

    @property
    def passing(self) -> bool:
        """True while commands that keep the limits are passed on."""
        return self.state in (State.NORMAL, State.INDICATING)

    @property
    def motion(self) -> Motion:
        """Motion of the table at the end of the last command: what was commanded, and what the sensor knows better.

        Of that no more than `following_tolerance`: a sensor whose sign or zero is wrong must not lead the table away.
        """
        most = self._config.following_tolerance
        known = min(max(self._offset, -most), most)
        return self._motion._replace(displacement=self._motion.displacement + known)

    @property
    def hold(self) -> float:
        """For how long a command on the way to rest is to be held [s]: Δt, and longer for a host that comes late."""
        return self._way.hold

    @property
    def given_up(self) -> bool:
        """True when commands were late so often that no way led to rest: the table controller has to stop the table."""
        return self._way.given_up

    @property
    def stands(self) -> bool:
        """True when the table stands at zero displacement by its commands, whatever is under way."""
        motion = self._motion
        near = abs(motion.velocity) <= SETTLED_VELOCITY and abs(motion.displacement) <= SETTLED_DISPLACEMENT
        return near and motion.acceleration == 0.0

    @property
    def at_rest(self) -> bool:
        """True when a ramp or hold has ended, and after an emergency stop."""
        if self.state is not State.HOLDING:
            return self.state is State.STOPPED
        return self._way.ended(self._motion, stop_commands)

    def check(self, step: int, command: float, late: float | None = None) -> bool:
        """Decide on the command of a step.

        Parameters
        ----------
        step : int
            Step index, larger than the last one.
        command : float
            Acceleration command [m/s²].
        late : float, optional
            How much longer than Δt the last command was held [s], negative when it was held for a shorter time; by
            default the steps that were skipped.

        Returns
        -------
        bool
            True when the command may go to the table as it is; otherwise it must not, and `advance` says what may.

        Raises
        ------
        ValueError
            The step lies in the past.
        """
        if step <= self._last_step:
            raise ValueError(f"command of step {step} comes after that of step {self._last_step}")
        if self._way.begun:
            return False
        unheard = self._last_step - self._last_measured
        skipped = step - self._last_step - 1
        missing = skipped * self._time_step
        silent = missing if late is None else late
        self._hold(silent)
        if self.passing:
            # A step that no clock has reached is not of this test, whatever the time is.
            self.record(self._passed_limits(step, command, max(silent, missing), unheard))
        if self.passing:
            self._last_step = step - 1
            self._send(command)
        else:
            self._last_step += min(skipped, self._whole_steps(silent) + 1)
        return self.passing

    def goes_on_without(self, late: float) -> bool:
        """Decide whether the test goes on while its next command does not come; the table holds the last one.

        Parameters
        ----------
        late : float
            Time since that command was due [s].

        Returns
        -------
        bool
            False when it has not come for too long, and before the table could no longer be brought to rest within
            displacement and velocity limit.
        """
        if not self.passing:
            return False
        step, held = self._last_step + 1 + self._whole_steps(late), self._motion.acceleration
        trips = [trip for trip in (self._stale_shear(step, late),) if trip is not None]
        if late > self._time_step:
            ahead = self._motion.after(held, late + self._time_step)
            trips += self._passed_on_the_way_to_rest(step, ahead)
        self.record(trip for trip in trips if trip.action is not Action.IGNORE)
        return self.passing

    def began_late(self, delay: float) -> None:
        """Correct the motion for a command that reached the table later than it was decided on.

        Parameters
        ----------
        delay : float
            [s].
        """
        change = (self._motion.acceleration - self._replaced) * delay
        self._motion = self._motion._replace(
            displacement=self._motion.displacement - change * (self._time_step - 0.5 * delay),
            velocity=self._motion.velocity - change,
        )

    def observe(self, measurement: TableMeasurement) -> None:
        """Check what the sensors say; a limit that is passed takes effect with the next command.

        Parameters
        ----------
        measurement : TableMeasurement
            Sensors at the end of a step.
        """
        if measurement.step > self._last_measured:
            self._last_measured = measurement.step
        applied, asked = measurement.applied_command, self._motion.acceleration
        if measurement.step == self._last_step and applied != asked and math.isfinite(applied):
            difference = (applied - asked) * self._time_step  # the motion follows what was really applied
            self._motion = self._motion._replace(
                displacement=self._motion.displacement + 0.5 * difference * self._time_step,
                velocity=self._motion.velocity + difference,
                acceleration=applied,
            )
        if math.isfinite(measurement.table_displacement):
            self._way.observe(measurement.step, measurement.table_displacement)
            difference = measurement.table_displacement - self._motion.displacement
            self._offset += self._offset_share * (difference - self._offset)
        self.record(
            self._measurement_check.step(measurement, partial(self._following.explains, self._motion.displacement))
        )

    def record(self, trips: Iterable[Trip]) -> None:
        """Take note of passed limits and begin what they ask for; each limit counts once until `reset` for an action.

        Parameters
        ----------
        trips : iterable of Trip
            Also those found elsewhere, such as by the stability indicator.
        """
        for trip in trips:
            if trip.action <= self._latched.get(trip.limit, Action.IGNORE):
                continue
            self._latched[trip.limit] = trip.action
            self._trips.append(trip)
            self._begin(trip.action)

    def request(self, action: Action) -> None:
        """Hold, ramp or stop the table without a limit: the operator asks for it, or the test has ended.

        Parameters
        ----------
        action : Action
            An emergency stop takes precedence over a ramp, and a ramp over a hold.
        """
        self._begin(action)

    def advance(self, late: float = 0.0) -> TableCommand | None:
        """Return the next command on the way to rest, while no command is passed on.

        Parameters
        ----------
        late : float
            How much longer than Δt the last command was held [s]. The way is planned anew where that matters.

        Returns
        -------
        TableCommand or None
            For one step each; zero acceleration without end when a hold has come to rest, None when the table gets no
            further command: at the end of a ramp, after an emergency stop, and when no way has led to rest.
        """
        # Held without end, a table whose controller is gone is noticed by nothing else.
        if self.state is State.HOLDING and self.at_rest:
            trip = self._stale_controller(self._last_step + 1, self._last_step - self._last_measured)
            self.record([trip] if trip is not None else [])
        self._last_step += self._whole_steps(late)
        self._hold(late)
        if not self._motion.plausible:  # a ramp would have no end
            self._begin(Action.EMERGENCY_STOP)
        command = self._way.next(self._motion, _PLANNERS.get(self.state))
        if command is None and not self.given_up:
            command = 0.0 if self.state is State.HOLDING else self._at_the_end()
        if command is None:
            self.state = State.STOPPED
            return None
        return self._send(command)

    def _at_the_end(self) -> float | None:
        """Return zero while the table is watched at the end of its way, then the first command of a further one."""
        if self.state is not State.RAMPING or not self.by_the_clock:
            return None
        if self._way.watches(self._last_step + 1):
            return 0.0
        found = self._way.found()
        if self._way.led_away is not None:
            before, after = (motion.displacement for motion in self._way.led_away)
            what, limit = "displacement that a way back was to take away", "sensors.table_displacement_scale"
            self.record([Trip(limit, "m", what, after, before, self._last_step, Action.INDICATE)])
        if found is None:
            return None
        self._motion = found
        return self._way.correct(found, ramp_commands)

    def _whole_steps(self, late: float) -> int:
        return max(0, math.floor(late / self._time_step + 1e-9))

    def _hold(self, late: float) -> None:
        """Follow the table while it has held the last command for longer than Δt, or for a shorter time."""
        if late:
            self._following.note(self._motion, self._whole_steps(late))
            self._motion = self._motion.after(self._motion.acceleration, late)

    def _send(self, command: float) -> TableCommand:
        self._last_step += 1
        self._following.note(self._motion)
        self._replaced = self._motion.acceleration
        self._motion = self._motion.after(command, self._time_step)
        return TableCommand(self._last_step, command)

    def _begin(self, action: Action) -> None:
        """Do what a limit asks for, unless something as severe is under way."""
        state = STATE_OF[action]
        self.emergency |= action is Action.EMERGENCY_STOP
        if SEVERITY[state] <= SEVERITY[self.state]:
            return
        self.state = state
        self._way.abandon()

    def _passed_limits(self, step: int, command: float, silent: float, unheard: int) -> list[Trip]:
        """Return every limit that a command passes."""
        config, trips = self._config, []
        stale = self._stale_shear(step, silent)
        if stale is not None:
            trips.append(stale)
        silence = self._stale_controller(step, unheard)
        if silence is not None:
            trips.append(silence)
        if not math.isfinite(command):
            trips.append(
                Trip("safety.non_finite_action", "", "command", command, math.nan, step, self._actions["non_finite"])
            )
        else:
            if abs(command) > config.acceleration_limit:
                trips.append(self._trip("acceleration", "m/s2", "command", command, step))
            increment = command - self._motion.acceleration
            if abs(increment) > config.increment_limit:
                trips.append(self._trip("increment", "m/s2", "change of the command", increment, step))
            trips += self._passed_on_the_way_to_rest(step, self._motion.after(command, self._time_step))
        return [trip for trip in trips if trip.action is not Action.IGNORE]

    def _passed_on_the_way_to_rest(self, step: int, motion: Motion) -> list[Trip]:
        trips = []
        way = stopping_range(motion, self._config, self._time_step)
        lowest, highest = way.lowest + self._offset, way.highest + self._offset
        farthest = highest if highest > -lowest else lowest
        if abs(farthest) > self._config.displacement_limit:
            trips.append(self._trip("displacement", "m", "predicted displacement until rest", farthest, step))
        if way.velocity > self._config.velocity_limit:
            trips.append(self._trip("velocity", "m/s", "predicted velocity until rest", way.velocity, step))
        return trips

    def _stale_shear(self, step: int, silent: float) -> Trip | None:
        steps = self._whole_steps(silent)
        if steps <= self._silent_steps or self._actions["stale_shear"] is Action.IGNORE:
            return None
        return self._trip("stale_shear", "s", "time without a command", steps * self._time_step, step)

    def _stale_controller(self, step: int, unheard: int) -> Trip | None:
        if unheard <= self._unheard_steps or self._actions["stale_controller"] is Action.IGNORE:
            return None
        return self._trip("stale_controller", "s", "time without a measurement", unheard * self._time_step, step)

    def _trip(self, limit: str, unit: str, quantity: str, value: float, step: int) -> Trip:
        key = f"{limit}_time" if unit == "s" else f"{limit}_limit"
        allowed = getattr(self._config, key)
        return Trip(f"safety.{key}", unit, quantity, value, allowed, step, self._actions[limit])


_COMMAND_LIMITS = (
    *("displacement", "velocity", "acceleration", "increment", "stale_shear", "stale_controller", "non_finite"),
)

#: What makes the commands of the way to rest.
_PLANNERS: dict[State, Planner] = {State.HOLDING: stop_commands, State.RAMPING: ramp_commands}
