"""The supervisor in the path of the command: it passes a command on, replaces it by a ramp, or stops the table."""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum

from bmd_rths_core.safety.commanded_motion import REST, Motion, stopping_range
from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.measurement_check import MeasurementCheck
from bmd_rths_core.safety.ramp import ramp_commands, stop_commands
from bmd_rths_core.safety.trips import Action, Trip
from bmd_rths_core.table.controller import TableCommand, TableMeasurement

#: Time constant of the mean difference between measured and commanded displacement [s].
OFFSET_TIME = 1.0


class State(Enum):
    """What the supervisor does."""

    NORMAL = "normal"  # commands are passed on
    INDICATING = "indicating"  # so they are, but a limit was passed that is only indicated
    HOLDING = "holding"  # the table is braked, and then stays where it is
    RAMPING = "ramping"  # the table is on its way to rest at zero displacement
    STOPPED = "stopped"  # nothing is passed on


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
        self._config = config
        self._time_step = time_step
        self._measurement_check = MeasurementCheck(config, time_step)
        self._actions = {name: config.action(name) for name in _COMMAND_LIMITS}
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
        self._plan: list[float] | None = None
        self._measurement_check.reset()

    def resume(self, step: int, motion: Motion, offset: float, tracking_mean_square: float) -> None:
        """Take up a test in the middle, none of whose limits was passed and none of whose sensors was lost.

        Parameters
        ----------
        step : int
            The step that comes next.
        motion : Motion
            Integral of the commands until then.
        offset : float
            Slow difference of the measured displacement to it [m].
        tracking_mean_square : float
            Mean square of the tracking error [m²/s⁴].
        """
        self.reset()
        self._motion, self._offset = motion, offset
        self._last_step = self._last_measured = step - 1
        self._measurement_check.resume(tracking_mean_square)

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
    def at_rest(self) -> bool:
        """True when a ramp or hold has ended, and after an emergency stop."""
        return self.state is State.STOPPED or (self.state is State.HOLDING and self._plan == [])

    def check(self, step: int, command: float) -> bool:
        """Decide on the command of a step.

        Parameters
        ----------
        step : int
            Step index, larger than the last one.
        command : float
            Acceleration command [m/s²].

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
        if self._plan is not None:
            return False
        unheard = self._last_step - self._last_measured
        skipped = step - self._last_step - 1
        self._hold(skipped)
        if self.passing:
            self.record(self._passed_limits(step, command, skipped, unheard))
        if self.passing:
            self._send(command)
        return self.passing

    def silence(self, steps: int) -> None:
        """Tell that no command has come for a time; the table has held the last one.

        Parameters
        ----------
        steps : int
            Whole steps since the next command was due.
        """
        trip = self._stale_shear(self._last_step + 1 + steps, steps)
        if self.passing and trip is not None:
            self.record([trip])
        if not self.passing and self._plan is None:
            self._hold(steps)

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
            difference = measurement.table_displacement - self._motion.displacement
            self._offset += self._offset_share * (difference - self._offset)
        self.record(self._measurement_check.step(measurement))

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

    def advance(self) -> TableCommand | None:
        """Return the next command on the way to rest, while no command is passed on.

        Returns
        -------
        TableCommand or None
            For one step each; zero acceleration without end when a hold has come to rest, None when the table gets no
            further command: at the end of a ramp and after an emergency stop.
        """
        if not self._motion.plausible:  # a ramp would have no end
            self._begin(Action.EMERGENCY_STOP)
        if self._plan is None:
            self._plan = self._way_to_rest()
        if self._plan:
            return self._send(self._plan.pop())
        if self.state is State.HOLDING:
            return self._send(0.0)
        self.state = State.STOPPED
        return None

    def _hold(self, steps: int) -> None:
        """Follow the table while it has held the last command."""
        if steps:
            self._motion = self._motion.after(self._motion.acceleration, steps * self._time_step)
            self._last_step += steps

    def _send(self, command: float) -> TableCommand:
        self._last_step += 1
        self._motion = self._motion.after(command, self._time_step)
        return TableCommand(self._last_step, command)

    def _begin(self, action: Action) -> None:
        """Do what a limit asks for, unless something as severe is under way."""
        state = _STATES[action]
        self.emergency |= action is Action.EMERGENCY_STOP
        if _SEVERITY[state] <= _SEVERITY[self.state]:
            return
        self.state = state
        self._plan = None

    def _way_to_rest(self) -> list[float]:
        """Return the commands to rest, the last one first."""
        if self.state is State.HOLDING:
            commands = stop_commands(self._motion, self._config, self._time_step)
        elif self.state is State.RAMPING:
            commands = ramp_commands(self._motion, self._config, self._time_step)
        else:
            return []
        plan: list[float] = commands[::-1].tolist()
        return plan

    def _passed_limits(self, step: int, command: float, skipped: int, unheard: int) -> list[Trip]:
        """Return every limit that a command passes."""
        config, trips = self._config, []
        stale = self._stale_shear(step, skipped)
        if stale is not None:
            trips.append(stale)
        if unheard > config.stale_controller_limit:
            trips.append(self._trip("stale_controller", "steps", "steps without a measurement", unheard, step))
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
            trips += self._passed_on_the_way_to_rest(step, command)
        return [trip for trip in trips if trip.action is not Action.IGNORE]

    def _passed_on_the_way_to_rest(self, step: int, command: float) -> list[Trip]:
        trips = []
        way = stopping_range(self._motion.after(command, self._time_step), self._config, self._time_step)
        lowest, highest = way.lowest + self._offset, way.highest + self._offset
        farthest = highest if highest > -lowest else lowest
        if abs(farthest) > self._config.displacement_limit:
            trips.append(self._trip("displacement", "m", "predicted displacement until rest", farthest, step))
        if way.velocity > self._config.velocity_limit:
            trips.append(self._trip("velocity", "m/s", "predicted velocity until rest", way.velocity, step))
        return trips

    def _stale_shear(self, step: int, skipped: int) -> Trip | None:
        if skipped <= self._config.stale_shear_limit or self._actions["stale_shear"] is Action.IGNORE:
            return None
        return self._trip("stale_shear", "steps", "steps without a command", skipped, step)

    def _trip(self, limit: str, unit: str, quantity: str, value: float, step: int) -> Trip:
        allowed = getattr(self._config, f"{limit}_limit")
        return Trip(f"safety.{limit}_limit", unit, quantity, value, allowed, step, self._actions[limit])


_COMMAND_LIMITS = (
    *("displacement", "velocity", "acceleration", "increment", "stale_shear", "stale_controller", "non_finite"),
)

_STATES = {
    Action.IGNORE: State.NORMAL,
    Action.INDICATE: State.INDICATING,
    Action.HOLD: State.HOLDING,
    Action.RAMP: State.RAMPING,
    Action.EMERGENCY_STOP: State.STOPPED,
}
_SEVERITY = {state: severity for severity, state in enumerate(State)}
