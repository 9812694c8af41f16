"""The table driver as a state machine: check, exchange, observe, and the way to rest. It is told the time.

This is the one place where a command reaches a table. In-process loop, ROS node, identification and fault rig host it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from bmd_rths_core.loop.early_end import early_end
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.safety import Action, SafetySupervisor, State
from bmd_rths_core.table.calibration import Calibration
from bmd_rths_core.table.controller import (
    AsynchronousTableController,
    NoAnswer,
    TableCommand,
    TableController,
    TableMeasurement,
)

#: Time between two looks at an answer that has not come [s].
ANSWER_PERIOD = 0.0005

#: Looks at an overdue command before it counts as missing: the host reads what has arrived between two of them, so that
#: a host that was held up does not blame what lies unread.
LOOKS_BEFORE_SILENCE = 20

#: A host may be held up so often while a command is missing; one that is slow at every look must not go on for ever.
MOST_EXCUSES = 3

#: What is told of a stop that the table controller did not confirm.
NOT_CONFIRMED = "the table controller did not confirm that the table is at rest"

#: States in which the table may move.
_MOVING = (DriveState.FOLLOWING, DriveState.RETURNING, DriveState.HELD)


class TableDriver:
    """Pass commands to a table while they keep the limits, and bring it to rest when they do not, or end.

    Parameters
    ----------
    table : TableController
        The table.
    supervisor : SafetySupervisor
        Decides on every command and plans the way to rest.
    time_step : float
        Δt [s].
    lockstep : bool
        Steps follow each other as fast as they can, and each is held for Δt by definition. Otherwise each command is
        held until the next one, by the clock.
    on_measurement : callable
        Gets every `TableMeasurement` of the test, in the order of the steps.
    on_rest_command, on_rest_measurement : callable, optional
        Get every `TableCommand` that the controller was given on the way to rest, and every `TableMeasurement` that
        answers one. They get nothing more of a table that stands, held or at rest.
    calibration : Calibration, optional
        Of the sensors: limits, loop and record have what it makes of the readings. Readings are SI units without it.

    Attributes
    ----------
    state : DriveState
        What it does.
    outcome : Outcome or None
        How the driver ended the test; None when it did not.
    reason : str
        Why, in one line.
    last_passed : int
        Last step whose command was passed on; -1 before the first.
    sent_at : float
        When the last command went out; -inf before the first.
    latest : TableMeasurement or None
        The last measurement, on the way to rest too.
    stop_problem : str
        Text that says what is missing of the confirmation of the last stop; empty when it was confirmed, when nothing
        was stopped yet, and when the controller cannot tell.

    Notes
    -----
    All times are of one monotonic clock [s], and never run backwards. A table that lives by steps (`by_steps` of the
    controller) moves with the commands, not with the clock.
    """

    def __init__(
        self,
        table: TableController,
        supervisor: SafetySupervisor,
        time_step: float,
        lockstep: bool,
        on_measurement: Callable[[TableMeasurement], None],
        on_rest_command: Callable[[TableCommand], None] = lambda command: None,
        on_rest_measurement: Callable[[TableMeasurement], None] = lambda measurement: None,
        calibration: Calibration | None = None,
    ) -> None:
        self.supervisor = supervisor
        self._table = table
        self._time_step = time_step
        self._lockstep = lockstep
        self._by_steps = lockstep or bool(getattr(table, "by_steps", False))
        supervisor.by_the_clock = not self._by_steps
        self._polled = table if isinstance(table, AsynchronousTableController) else None
        self._calibration = calibration
        self._on_measurement = on_measurement
        self._on_rest_command, self._on_rest_measurement = on_rest_command, on_rest_measurement
        self.state = DriveState.RELEASED
        self._forget()

    def _forget(self) -> None:
        self.supervisor.reset()
        self.outcome: Outcome | None = None
        self.reason = ""
        self.last_passed = self._last_on_the_way = -1
        self.latest: TableMeasurement | None = None
        self.stop_problem = ""
        self._due = math.inf  # of the next command on the way to rest
        # Until then the supervisor has followed the table; None before step 0.
        self._followed_until: float | None = None
        self.sent_at = -math.inf
        self._looks, self._excuses, self._looked_at = 0, 0, 0.0

    # ---- what the host asks for

    def arm(self) -> None:
        """Connect the table and make it ready for step 0.

        Raises
        ------
        OSError, RuntimeError
            The table moves, or the controller is not there or does not want to: what is known of the last test and of
            its stop stays known.
        """
        if self.moving:
            raise RuntimeError("the table moves, it is not armed anew")
        if self.state is DriveState.ARMED:
            self.state = DriveState.AT_REST
        self._table.connect()
        self._forget()
        self.state = DriveState.ARMED

    def command(self, step: int, acceleration: float, now: float) -> None:
        """Pass the command of a step on, or begin the way to rest in its place.

        Parameters
        ----------
        step : int
            Step index, larger than the last one.
        acceleration : float
            Acceleration command [m/s²].
        now : float
            Time [s].
        """
        if self.state not in (DriveState.ARMED, DriveState.FOLLOWING):
            return  # the test has ended
        self.state = DriveState.FOLLOWING
        if self.supervisor.check(step, acceleration, None if self._by_steps else self._late(now)):
            self.last_passed = step
            self._exchange(TableCommand(step, acceleration), now)
        else:
            self._due = self._followed_until = now
            self._end(Outcome.LIMIT, self.supervisor.reason, now)

    def finish(self, action: Action, now: float) -> None:
        """Bring the table to rest, because the test has ended elsewhere.

        Parameters
        ----------
        action : Action
            How. It takes precedence over a milder one that is under way.
        now : float
            Time [s].
        """
        self.supervisor.request(action)
        self._begin_way_to_rest(now)

    def stop(self, action: Action, outcome: Outcome, reason: str, now: float) -> None:
        """End the test: the operator or a lost peer asks for it.

        Parameters
        ----------
        action : Action
            As for `finish`.
        outcome : Outcome
            What it makes of the test.
        reason : str
            Why, in one line.
        now : float
            Time [s].
        """
        self.supervisor.request(action)
        self._end(outcome, reason, now)

    def poll(self, now: float) -> float:
        """Do what is due.

        Parameters
        ----------
        now : float
            Time [s].

        Returns
        -------
        float
            When to call again at the latest; before that, what has arrived is to be read.
        """
        answer_due = self._look_for_answers(now)
        if now >= self._due:
            self._advance(now)
        return min(self._due, answer_due, self._look_at_silence(now))

    def halt(self) -> None:
        """Stop the table by its controller: by the fastest way it has after an emergency stop was asked for."""
        problem = self._stopped()
        self._due = math.inf
        if self.state is DriveState.RELEASED:
            return
        self.state = DriveState.AT_REST
        self.stop_problem = problem
        if problem:
            self.outcome = self.outcome or Outcome.FAILED
            self.reason = self.reason or problem

    def release(self) -> None:
        """Stop the table and give up the connection."""
        self.halt()
        self._table.close()
        self.state = DriveState.RELEASED

    @property
    def moving(self) -> bool:
        """True while the table may move."""
        return self.state in _MOVING

    # ---- details

    def _stopped(self) -> str:
        """Ask the controller for the stop, and return what is missing of its confirmation."""
        try:
            if self.supervisor.emergency:
                self._table.emergency_stop()
            else:
                self._table.stop()
        except (OSError, RuntimeError) as error:  # the protocol forbids it; what follows a stop must not depend on it
            return f"{NOT_CONFIRMED}: {error}"
        return "" if getattr(self._table, "stop_confirmed", True) else NOT_CONFIRMED

    def _end(self, outcome: Outcome, reason: str, now: float) -> None:
        """End the test from here; the first outcome stays, the last reason is told."""
        self.outcome = self.outcome or outcome
        self.reason = reason
        self._begin_way_to_rest(now)

    def _late(self, now: float) -> float:
        """Return how much longer than Δt the last command was held until now [s]; negative when it was shorter."""
        return 0.0 if self._followed_until is None else now - self._followed_until

    def _late_on_the_way(self, now: float) -> float:
        """Return the same for the way to rest; a table that lives by steps knows whole ones."""
        if self._lockstep:
            return 0.0
        late = self._late(now)
        return max(0, math.floor(late / self._time_step + 1e-9)) * self._time_step if self._by_steps else late

    def _exchange(self, command: TableCommand, now: float) -> None:
        """Move the table for one step; its measurement comes now, later, or not at all."""
        self._followed_until = now + self._time_step
        self.sent_at = now
        self._looks = self._excuses = 0
        measurement = None
        try:
            if self._polled is None or self._lockstep:
                measurement = self._table.exchange(command)
            else:
                sent_at = self._polled.begin(command)
                if sent_at is not None and not self._by_steps:
                    self.supervisor.began_late(sent_at - now)
                    self.sent_at = sent_at
        except NoAnswer:
            return
        except (OSError, RuntimeError) as error:
            self._fail(command.step, error, now)
        if measurement is not None:  # what the host makes of it is no failure of the controller
            self._observe(measurement)

    def _look_for_answers(self, now: float) -> float:
        """Take the measurements that have come without waiting for them, and return when to look again."""
        while self._polled is not None and (self.moving or self.state is DriveState.ARMED):
            try:
                measurement = self._polled.poll()
            except (OSError, RuntimeError) as error:
                self._fail(self.last_passed if self.moving else -1, error, now)
                break
            if measurement is None:
                return now + ANSWER_PERIOD if self._polled.awaiting else math.inf
            self._observe(measurement)
        return math.inf

    def _observe(self, measurement: TableMeasurement) -> None:
        if self._calibration is not None:
            measurement = self._calibration.calibrated(measurement)
        self.supervisor.observe(measurement)
        self.latest = measurement
        if measurement.step <= self.last_passed:  # the way to rest is no part of the test
            self._on_measurement(measurement)
        elif measurement.step <= self._last_on_the_way:
            self._on_rest_measurement(measurement)

    def _look_at_silence(self, now: float) -> float:
        """Begin the way to rest when no command comes any more, or when it would soon be too late for it."""
        if self._lockstep or self.state is not DriveState.FOLLOWING or self._followed_until is None:
            return math.inf
        overdue = self._followed_until + 0.2 * self._time_step
        if now < overdue:
            return overdue
        held_up = now - self._looked_at > self._time_step
        excused = held_up and self._excuses < MOST_EXCUSES
        self._looked_at = now
        self._excuses += excused
        self._looks = 1 if excused else self._looks + 1
        if self._looks < LOOKS_BEFORE_SILENCE and (excused or not held_up):
            return now
        late = self._late(now)
        if not self.supervisor.goes_on_without(late):
            self._due = now
            self._end(Outcome.LIMIT, self.supervisor.reason, now)
            return self._due
        return now + 0.2 * self._time_step

    def _fail(self, step: int, error: Exception, now: float) -> None:
        """Stop the table as fast as it can, because its controller cannot go on."""
        self.supervisor.request(Action.EMERGENCY_STOP)
        where = f" at step {step}" if self.moving and step >= 0 else ""
        self._end(Outcome.FAILED, f"table controller{where}: {error}", now)

    def _note_limit(self) -> None:
        """Note a limit that the sensors passed in the last slot of the test, or on the way to rest."""
        if self.outcome is None and self.supervisor.reason:
            self.outcome, self.reason = Outcome.LIMIT, self.supervisor.reason

    def _begin_way_to_rest(self, now: float) -> None:
        """Send the first command on the way to rest now or when the last one has been held for Δt."""
        if self.state in (DriveState.AT_REST, DriveState.RELEASED) and not self.supervisor.emergency:
            return
        self._note_limit()
        if self.state is DriveState.ARMED or self.supervisor.emergency:
            self.halt()
            return
        if self.supervisor.at_rest:  # held already; what is not more than that changes nothing
            return
        if self.state is not DriveState.RETURNING:
            self.state = DriveState.RETURNING
            if (be_patient := getattr(self._table, "be_patient", None)) is not None:
                be_patient()
            in_its_slot = now if self._lockstep or self._followed_until is None else self._followed_until
            self._due = min(self._due, in_its_slot)
        if now >= self._due:
            self._advance(now)

    def _advance(self, now: float) -> None:
        """Send one command on the way to rest; at its end stop the table, except after a hold."""
        self._note_limit()
        stands = self.supervisor.at_rest  # after a hold, without end
        late = self._late_on_the_way(now)
        command = self.supervisor.advance(late)
        if command is not None:
            if not stands:
                self._last_on_the_way = command.step
            self._exchange(command, now)
            if not stands:
                self._on_rest_command(command)
        if self.supervisor.state is State.STOPPED:
            if self.moving:
                outcome, reason = early_end(self.supervisor, late) or (self.outcome, "")
                if reason not in self.reason:
                    self.outcome = self.outcome or outcome
                    self.reason = f"{self.reason}; {reason}" if self.reason else reason
                self.halt()
            return
        # A limit that asks for more than a hold brings a held table back.
        self.state = DriveState.HELD if self.supervisor.at_rest else DriveState.RETURNING
        if self._lockstep and self.state is not DriveState.HELD:
            self._due = now
        else:  # small delays do not add up, and large ones are never caught up with
            sent_at = now if command is None else self.sent_at
            small = sent_at - self._due < 0.5 * self.supervisor.hold
            self._due = (self._due if small else sent_at) + self.supervisor.hold
