"""Numerical substructure: the clock of the loop. Corrected shear in, desired acceleration and required force out."""

from __future__ import annotations

import json
import math
import sys
import time

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.build import make_numerical_substructure, make_stability_indicator
from bmd_rths_core.loop.deadlines import DeadlineMonitor
from bmd_rths_core.safety import Action, Trip
from bmd_rths_msgs_py.topics import (
    CORRECTED_FORCE,
    DESIRED_ACCELERATION,
    GROUND_ACCELERATION,
    NUMERICAL_SUBSTRUCTURE,
    RECORDER,
    REQUIRED_FORCE,
    ROLES,
)
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode
from bmd_rths_nodes.ros.status import NodeStatus

#: In lockstep, a step that has not closed after this time ends the test [s].
LOCKSTEP_TIMEOUT = 5.0

#: In lockstep, the longest wait for a recorder that is far behind [s]: longer than it may be silent, and then get again
#: what was lost meanwhile, which Fast DDS repeats after 3 s.
RECORDING_TIMEOUT = 15.0

#: In lockstep the loop waits when it is so many steps ahead of the recorder: fewer than a publisher keeps.
LONGEST_LEAD = 400

#: Time between the moment all nodes are ready and step 0 [s].
START_DELAY = 0.05

#: A peer that tells nothing for this long is lost [s]; every node tells its status once a second.
LONGEST_SILENCE = 5.0

#: Shortest time between two reports of missed deadlines [s].
MISS_REPORT_PERIOD = 0.1


class NumericalSubstructureNode(StageNode):
    """Node around `NumericalSubstructure` or `NonlinearSubstructure` of the core.

    It waits until every node of the loop reports that it is matched with its peers, runs the ground motion from step 0
    to its end, and then tells on /diagnostics how the test ended. In real time each step begins at its time on the
    wall clock, with the shear that is there; in lockstep it begins when the shear of the step before arrives.
    """

    ROLE = NUMERICAL_SUBSTRUCTURE
    SECTIONS = ("run", "ground_motion", "numerical_substructure", "nonlinear", "safety")

    def configure_stage(self, config: Config) -> None:
        """Make stage and topics and read the ground motion."""
        motion = select_ground_motion(config.ground_motion, config.run.time_step)
        self._ground = motion.acceleration.tolist()
        self._stage = make_numerical_substructure(config)
        self._stability_indicator = make_stability_indicator(config)
        self._lockstep = config.run.lockstep
        self._send_desired_acceleration = self.publish_to(DESIRED_ACCELERATION)
        self._send_required_force = self.publish_to(REQUIRED_FORCE)
        self._send_ground_acceleration = self.publish_to(GROUND_ACCELERATION)
        self._peers = {role for role in ROLES if role != self.ROLE and (role != RECORDER or config.run.record)}
        self._ready_peers: set[str] = set()
        self._heard: dict[str, float] = {}
        self.subscribe_to(CORRECTED_FORCE, self._on_corrected_force)
        self.listen_to_peers(self._on_peer)
        self._forget_the_last_test()

    def reset_stage(self) -> None:
        """Return to rest before step 0."""
        self._stage.reset()
        self._stability_indicator.reset()
        self._ready_peers.clear()
        self._forget_the_last_test()

    def _forget_the_last_test(self) -> None:
        self._deadlines = DeadlineMonitor(len(self._ground), self.config.run.max_consecutive_misses)
        self._step = 0
        self._feedback = 0.0
        self._due = math.inf
        self._recorded_steps = 0
        self._closed = self._waits_for_recorder = False
        self._outcome = ""
        self._trip: Trip | None = None

    def on_disturbance(self, problem: str) -> None:
        """End the test."""
        if self.state == status.RUNNING:
            self._end("failed", problem)

    def stop_stage(self) -> None:
        """End a test that is under way."""
        if self.configured:
            self._due = math.inf
        if self.state == status.RUNNING:
            self._end("stopped", "stopped by the operator")

    def status_values(self) -> dict[str, str]:
        """Tell progress, deadlines, and at the end the outcome."""
        if not self.configured or self.state == status.INACTIVE:
            return {}
        timing = self._deadlines.statistics()
        values = {
            "step": str(self._step),
            "steps": str(len(self._ground)),
            "clock": "lockstep" if self._lockstep else "real time",
            "missed_deadlines": str(timing.missed_deadlines),
            "max_consecutive_misses": str(timing.max_consecutive_misses),
            "late_ticks": str(timing.late_ticks),
            **{f"closure_ms_{name}": repr(value) for name, value in timing.closure_ms.items()},
            "stability_indicator": f"{self._stability_indicator.value:.3g}",
            "outcome": self._outcome,
            "waiting_for": ", ".join(sorted(self._peers - self._ready_peers)) if self._step == 0 else "",
        }
        if self._trip is not None:
            values["trip"] = str(self._trip)
        if self._outcome == "limit" and self._trip is not None:
            values["action"] = self._trip.action.name.lower()
        if self._outcome:
            values["missed_steps"] = json.dumps(timing.missed_steps)
        return values

    def poll(self, now: float) -> float:
        """Begin the next step when it is time."""
        if not self.configured:
            return super().poll(now)
        if self.state == status.RUNNING and now >= self._status_due:
            self._look_for_lost_peers(now)
        if now >= self._due:
            if self.state == status.READY:
                self._start(now)
            elif self.state != status.RUNNING:  # a peer was lost between the decision to start and the start
                self._due = math.inf
            elif self._lockstep and self._closed and not self._waits_for_recorder:
                self._begin_step_when_recorded()
            elif self._lockstep:
                late = f"was not recorded within {RECORDING_TIMEOUT:g} s"
                stuck = f"did not close within {LOCKSTEP_TIMEOUT:g} s"
                self._end("failed", f"step {self._step - 1} {late if self._waits_for_recorder else stuck}")
            else:
                self._tick(now)
        return min(super().poll(now), self._due)

    def _look_for_lost_peers(self, now: float) -> None:
        """End the test when a peer is lost whose messages the loop does not miss: the recorder."""
        silent = sorted(peer for peer in self._peers if now - self._heard[peer] > LONGEST_SILENCE)
        if silent:
            self._end("failed", f"nothing was heard of {', '.join(silent)} for {LONGEST_SILENCE:g} s")

    def _start(self, now: float) -> None:
        self.set_state(status.RUNNING)
        self._due = now
        self._begin_step()

    def _tick(self, now: float) -> None:
        if now - self._due > self.config.run.time_step:
            # Steps are never run in a burst: each command is held for a full step, and the schedule moves.
            self._deadlines.late_ticks += 1
            self._due = now
        missed_before = self._deadlines.missed_deadlines
        self._deadlines.expired()
        if self._deadlines.missed_deadlines > missed_before:
            self.level, self.note = status.WARN, f"step {self._step - 1} missed its deadline"
            # Told soon, but not more often than this: telling takes time that the loop lacks just now.
            self.status_due_within(MISS_REPORT_PERIOD)
        if self._deadlines.exhausted:
            misses = self.config.run.max_consecutive_misses
            self._end("failed", f"more than {misses} deadlines in a row were missed, the last at step {self._step - 1}")
        else:
            self._begin_step()

    def _begin_step(self) -> None:
        step = self._step
        if step == len(self._ground):
            self._end("finished", "end of the ground motion")
            return
        ground_acceleration = self._ground[step]
        response = self._stage.step(ground_acceleration, self._feedback)
        trip = self._stability_indicator.step(step, self._feedback, self._stage.displacements)
        if trip is not None:
            self._trip = trip
            if trip.action > Action.INDICATE:
                self._end("limit", str(trip))
                return
        now = time.perf_counter()
        self._deadlines.opened(step, now)
        self._step = step + 1
        self._due = now + LOCKSTEP_TIMEOUT if self._lockstep else self._due + self.config.run.time_step
        self._send_desired_acceleration(step, response.desired_acceleration)
        self._send_required_force(step, response.required_force)
        self._send_ground_acceleration(step, ground_acceleration)

    def _on_corrected_force(self, step: int, force: float) -> None:
        if self.state != status.RUNNING:
            return
        # A shear that comes too late is a missed deadline, but still newer than the one that is held.
        self._feedback = force
        now = time.perf_counter()
        if self._deadlines.closed(step, now) and self._lockstep:
            self._closed = True
            self._due = now

    def _begin_step_when_recorded(self) -> None:
        """Begin the next step of lockstep unless the recorder is far behind: it would lose what nobody keeps."""
        waited = self._waits_for_recorder
        lead = self._step - self._recorded_steps
        self._waits_for_recorder = self.config.run.record and lead > LONGEST_LEAD
        if not self._waits_for_recorder:
            self._closed = False
            self._begin_step()
        elif not waited:
            self._due = time.perf_counter() + RECORDING_TIMEOUT

    def _on_peer(self, peer: NodeStatus) -> None:
        if peer.state == status.TRIPPED and self.state == status.RUNNING:
            self._end(peer.values.get("outcome") or "failed", f"{peer.role}: {peer.message}")
        self._heard[peer.role] = time.perf_counter()
        if peer.role == RECORDER:
            told = peer.values.get("recorded_steps", "")
            self._recorded_steps = int(told) if told.isdecimal() else 0
            if self._waits_for_recorder and self.state == status.RUNNING:
                self._begin_step_when_recorded()
        if peer.state == status.READY:
            self._ready_peers.add(peer.role)
        else:
            self._ready_peers.discard(peer.role)
        if self.state == status.READY:
            all_ready = self._peers <= self._ready_peers
            if not all_ready:
                self._due = math.inf
            elif self._due == math.inf:
                self._due = time.perf_counter() + START_DELAY

    def _end(self, outcome: str, reason: str) -> None:
        self._deadlines.expired()
        self._due = math.inf
        self._outcome = outcome
        level = status.OK if outcome in ("finished", "stopped") else status.ERROR
        self.set_state(status.ENDED, reason, level)
        timing = self._deadlines.statistics()
        closure = ", ".join(f"{name} {value:.2f}" for name, value in timing.closure_ms.items())
        deadlines = f"{timing.missed_deadlines} of {self._step} deadlines missed"
        self.get_logger().info(f"{outcome}: {reason}; {deadlines}, closure [ms] {closure}")


def main() -> int:
    """Run the node."""
    return run_nodes([NumericalSubstructureNode])


if __name__ == "__main__":
    sys.exit(main())
