"""The conductor as a state machine: start gate, ticks, deadlines, end. It is told the time.

This is the one place where a step begins. In-process loop, ROS node and fault rig host it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

from bmd_rths_core.loop.deadlines import DeadlineMonitor
from bmd_rths_core.loop.numerical_stage import NumericalStage
from bmd_rths_core.loop.peers import PEER_LOST_AFTER, Peer, Peers
from bmd_rths_core.loop.states import NodeState, Outcome
from bmd_rths_core.loop.substepped_stage import IntegrationLate
from bmd_rths_core.safety import Action, StabilityIndicator, Trip
from bmd_rths_core.table.controller import TableMeasurement

#: In lockstep, a step that has not closed after this time ends the test [s].
LOCKSTEP_TIMEOUT = 5.0

#: In lockstep, the longest wait for a recorder that is far behind [s]: longer than it may be silent, and then get again
#: what was lost meanwhile, which Fast DDS repeats after 3 s.
RECORDING_TIMEOUT = 15.0

#: In lockstep the loop waits when it is so many steps ahead of the recorder: fewer than a publisher keeps.
LONGEST_LEAD = 400

#: Time between the moment all nodes are ready and step 0 [s].
START_DELAY = 0.05

#: A tick that is later than this part of Δt moves the schedule, so that no two commands come close to each other.
LATEST_TICK = 0.5

#: Time between two looks for lost peers [s].
LOOK_PERIOD = 1.0


class Begun(NamedTuple):
    """A step that begins.

    Parameters
    ----------
    step : int
        Step index k.
    ground_acceleration, desired_acceleration : float
        [m/s²].
    required_force : float
        [N].
    command : float
        What the command shaper gets [m/s²].
    """

    step: int
    ground_acceleration: float
    desired_acceleration: float
    required_force: float
    command: float


class Conductor:
    """Begin every step of a test when it is due, with the shear that is there, and end the test.

    Parameters
    ----------
    ground : sequence of float, length N
        Ground acceleration of every step [m/s²].
    numerical : NumericalStage
        The numerical substructure.
    indicator : StabilityIndicator or None
        Watches it.
    time_step : float
        Δt [s].
    lockstep : bool
        A step begins when the one before has closed; otherwise at its time, by the clock.
    longest_miss : float
        Time without a shear that was back in time that is tolerated [s].
    on_step : callable
        Gets every `Begun`.
    peers : collection of str
        Roles that have to be ready before step 0.
    recorder : str
        Role among them that records; the loop does not run away from it in lockstep. Empty when nobody records.

    Attributes
    ----------
    state : NodeState
        WAITING, RUNNING or ENDED.
    outcome : Outcome or None
        How the test ended; None while it has not.
    reason : str
        Why, in one line.
    trips : list of Trip
        Of the stability indicator.
    action : Action
        What the end asks of the table.
    step : int
        Steps begun so far.
    deadlines : DeadlineMonitor
        What missed its deadline.

    Notes
    -----
    All times are of one monotonic clock [s]. Steps are never run in a burst: a tick that is more than Δt/2 late
    moves the schedule.
    """

    def __init__(
        self,
        ground: Sequence[float],
        numerical: NumericalStage,
        indicator: StabilityIndicator | None,
        time_step: float,
        lockstep: bool,
        longest_miss: float,
        on_step: Callable[[Begun], None],
        peers: Collection[str] = (),
        recorder: str = "",
    ) -> None:
        self._ground = ground
        self._numerical = numerical
        self._indicator = indicator
        self._time_step = time_step
        self._lockstep = lockstep
        self._longest_miss = longest_miss
        self._on_step = on_step
        self._peers = Peers(peers, recorder)
        self._keeps_to_recorder = bool(recorder)
        self.reset()

    def reset(self) -> None:
        """Forget the last test and wait for the peers."""
        self._numerical.reset()
        if self._indicator is not None:
            self._indicator.reset()
        self.deadlines = DeadlineMonitor(self._time_step, self._longest_miss)
        self.state = NodeState.WAITING
        self.outcome: Outcome | None = None
        self.reason = ""
        self.trips: list[Trip] = []
        self.action = Action.RAMP
        self.step = 0
        self._peers.reset()
        self._feedback, self._fed_back, self._measured = 0.0, -1, -1
        self._due = self._look_due = math.inf
        self._closed = self._waits_for_recorder = False

    @property
    def steps(self) -> int:
        """Steps of the whole ground motion."""
        return len(self._ground)

    @property
    def waiting_for(self) -> list[str]:
        """Peers that are not ready, before step 0."""
        return self._peers.not_ready if self.step == 0 else []

    # ---- what the host tells

    def poll(self, now: float, ready: bool = True) -> float:
        """Begin the next step when it is due.

        Parameters
        ----------
        now : float
            Time [s].
        ready : bool
            The host itself is ready for step 0.

        Returns
        -------
        float
            When to call again at the latest.
        """
        if self.state is NodeState.WAITING:
            self._look_at_the_gate(now, ready)
        elif self.state is NodeState.RUNNING:
            if now >= self._look_due:
                self._look_for_lost_peers(now)
            if now >= self._due:
                self._on_due(now)
        return min(self._due, self._look_due)

    def passed_on(self, at: float) -> None:
        """Take note of when the last command went out: one that was held up since its tick moves the schedule, too.

        For a host that computes nothing between the two: one that does is as late at every command, and keeps its
        period.

        Parameters
        ----------
        at : float
            Time [s]; that of an earlier command changes nothing.
        """
        runs = self.state is NodeState.RUNNING and not self._lockstep
        if runs and self._due - at < (1.0 - LATEST_TICK) * self._time_step:
            self.deadlines.late_ticks += 1
            self._due = at + self._time_step

    def hear(self, peer: Peer, now: float) -> None:
        """Take note of what a peer says of itself.

        Parameters
        ----------
        peer : Peer
            The peer.
        now : float
            Time [s].
        """
        self._peers.hear(peer, now)
        if peer.state is NodeState.TRIPPED and self._is_ended_by(peer):
            self.end(peer.outcome or Outcome.FAILED, f"{peer.role}: {peer.reason}", now)
        elif self.state is NodeState.RUNNING and peer.role in self._peers.roles and peer.has_left:
            self.end(Outcome.FAILED, f"{peer.role} takes no part any more: it is {peer.state}", now)
        if self._waits_for_recorder and self.state is NodeState.RUNNING:
            self._begin_when_recorded(now)

    def shear(self, step: int, force: float, now: float) -> None:
        """Take the corrected shear of a step; the next one begins with it.

        Parameters
        ----------
        step : int
            Step index.
        force : float
            Shear to feed back [N].
        now : float
            Time [s].
        """
        if self.state is not NodeState.RUNNING or step < self._fed_back:
            return
        # A shear that comes too late is a missed deadline, but still newer than the one that is held.
        self._feedback, self._fed_back = force, step
        if self._numerical.takes_feedback or self._measured == step:
            self._close(step, now)

    def measured(self, measurement: TableMeasurement, now: float) -> None:
        """Take what the sensors said at the end of a step; an interface control begins the next one with it.

        Parameters
        ----------
        measurement : TableMeasurement
            Of a step that is begun.
        now : float
            Time [s].
        """
        if self.state is not NodeState.RUNNING or measurement.step < self._measured:
            return
        self._numerical.learn(measurement)
        self._measured = measurement.step
        if not self._numerical.takes_feedback and self._fed_back == self._measured:
            self._close(self._measured, now)

    def end(self, outcome: Outcome, reason: str, now: float) -> None:
        """End the test.

        Parameters
        ----------
        outcome : Outcome
            How.
        reason : str
            Why, in one line.
        now : float
            Time [s].
        """
        if self.state is NodeState.ENDED:
            return
        self.deadlines.expired(now)
        self._due = self._look_due = math.inf
        self.outcome, self.reason = outcome, reason
        self.state = NodeState.ENDED

    # ---- start gate and peers

    def _look_at_the_gate(self, now: float, ready: bool) -> None:
        if not ready or self._peers.not_ready:
            self._due = math.inf
        elif self._due == math.inf:
            self._due = now + START_DELAY
        elif now >= self._due:
            self.state = NodeState.RUNNING
            self._due = now
            self._look_due = now + LOOK_PERIOD if self._peers.roles else math.inf
            self._begin(now)

    def _is_ended_by(self, peer: Peer) -> bool:
        """Tell whether a peer that has tripped ends the test; before step 0 an operator's stop can be reset."""
        return self.state is NodeState.RUNNING or (
            self.state is NodeState.WAITING and peer.role in self._peers.roles and peer.outcome is Outcome.FAILED
        )

    def _look_for_lost_peers(self, now: float) -> None:
        """End the test when a peer is lost whose messages the loop does not miss: the recorder."""
        self._look_due = now + LOOK_PERIOD
        if silent := self._peers.silent(now):
            self.end(Outcome.FAILED, f"nothing was heard of {', '.join(silent)} for {PEER_LOST_AFTER:g} s", now)

    # ---- steps

    def _on_due(self, now: float) -> None:
        if not self._lockstep:
            self._tick(now)
        elif self._closed and not self._waits_for_recorder:
            self._begin_when_recorded(now)
        else:
            late = f"was not recorded within {RECORDING_TIMEOUT:g} s"
            stuck = f"did not close within {LOCKSTEP_TIMEOUT:g} s"
            self.end(Outcome.FAILED, f"step {self.step - 1} {late if self._waits_for_recorder else stuck}", now)

    def _tick(self, now: float) -> None:
        if self.step == self.steps:
            self._begin(now)
            return
        self.deadlines.expired(now)
        if self.deadlines.exhausted(now, self._due + self._time_step):
            longest = f"{self._longest_miss:g} s"
            reason = f"deadlines in a row were missed for more than {longest}, the last at step {self.step - 1}"
            self.end(Outcome.FAILED, reason, now)
        else:
            self._begin(now)

    def _begin(self, now: float) -> None:
        step = self.step
        if step == self.steps:
            self.end(Outcome.FINISHED, "end of the ground motion", now)
            return
        ground_acceleration = self._ground[step]
        try:
            response = self._numerical.step(ground_acceleration, self._feedback)
        except IntegrationLate as late:
            self.end(Outcome.FAILED, str(late), now)
            return
        if self._indicator is not None:
            acting = self._feedback if self._numerical.takes_feedback else response.required_force
            trip = self._indicator.step(step, acting, self._numerical.displacements)
            if trip is not None:
                self.trips.append(trip)
                if trip.action > Action.INDICATE:
                    self.action = trip.action
                    self.end(Outcome.LIMIT, str(trip), now)
                    return
        self.step = step + 1
        self._schedule(step, now)
        desired, required = response.desired_acceleration, response.required_force
        self._on_step(Begun(step, ground_acceleration, desired, required, response.command))

    def _close(self, step: int, now: float) -> None:
        """Close a step: everything that the next one begins with is there."""
        if self.deadlines.closed(step, now) and self._lockstep:
            self._closed = True
            self._due = now

    def _schedule(self, step: int, now: float) -> None:
        """Set when the next step is due, and with it the deadline of this one."""
        if self._lockstep:
            self.deadlines.opened(step, now, math.inf)
            self._due = now + LOCKSTEP_TIMEOUT
            return
        deadline = self._due + self._time_step
        self.deadlines.opened(step, now, deadline)
        late = now - self._due > LATEST_TICK * self._time_step
        if late:
            self.deadlines.late_ticks += 1
        self._due = now + self._time_step if late else deadline

    def _begin_when_recorded(self, now: float) -> None:
        """Begin the next step of lockstep unless the recorder is far behind: it would lose what nobody keeps."""
        waited = self._waits_for_recorder
        lead = self.step - self._peers.recorded_steps
        self._waits_for_recorder = self._keeps_to_recorder and lead > LONGEST_LEAD
        if not self._waits_for_recorder:
            self._closed = False
            self._begin(now)
        elif not waited:
            self._due = now + RECORDING_TIMEOUT
