"""Numerical substructure: the clock of the loop. Corrected shear in, desired acceleration and required force out.

A compensator that owns it gets the measurement too, and sends the command with the desired acceleration.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.build import make_numerical_stage, make_stability_indicator, sections_of_compensator
from bmd_rths_core.loop.conductor import Begun, Conductor
from bmd_rths_core.loop.peers import Peer
from bmd_rths_core.loop.states import NodeState, Outcome
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_msgs_py.topics import (
    CORRECTED_FORCE,
    DESIRED_ACCELERATION,
    GROUND_ACCELERATION,
    MEASUREMENT,
    NUMERICAL_SUBSTRUCTURE,
    RECORDER,
    REQUIRED_FORCE,
    ROLES,
    TABLE_DRIVER,
)
from bmd_rths_nodes.hardware.integration_process import IntegrationProcess
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.agreement import with_motion
from bmd_rths_nodes.ros.intra_process import IntraProcess
from bmd_rths_nodes.ros.messages import owns_the_interface
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.ros.triggers import NEXT_TEST, RESET, STOP, Refused

#: Shortest time between two reports of missed deadlines [s]: telling takes time that the loop lacks just then.
MISS_REPORT_PERIOD = 0.1


class NumericalSubstructureNode(StageNode):
    """Host of `bmd_rths_core.loop.conductor.Conductor` and the numerical substructure it drives.

    It converts and publishes; when a step begins, and how the test ends, is decided in the core.
    """

    ROLE = NUMERICAL_SUBSTRUCTURE
    SERVICES = (NEXT_TEST,)

    _conductor: Conductor

    def __init__(self, intra_process: IntraProcess) -> None:
        self._told: dict[str, NodeStatus] = {}
        self._table_moves = False
        self._integration: IntegrationProcess | None = None
        super().__init__(intra_process)

    def configure_stage(self, config: Config) -> None:
        """Make stage and topics and read the ground motion."""
        self._end_integration()
        self._motion = motion = select_ground_motion(config.ground_motion, config.run.time_step)
        self._stability_indicator = make_stability_indicator(config)
        if config.numerical_substructure.substeps > 1 and not config.run.lockstep:
            self._integration = IntegrationProcess(config)
        self._conductor = Conductor(
            motion.acceleration.tolist(),
            make_numerical_stage(config, motion.acceleration, self._integration),
            self._stability_indicator,
            config.run.time_step,
            config.run.lockstep,
            config.run.longest_miss_time,
            self._on_step,
            peers={role for role in ROLES if role != self.ROLE and (role != RECORDER or config.run.record)},
            recorder=RECORDER if config.run.record else "",
        )
        self._send_desired_acceleration = self.publish_to(DESIRED_ACCELERATION)
        self._send_required_force = self.publish_to(REQUIRED_FORCE)
        self._send_ground_acceleration = self.publish_to(GROUND_ACCELERATION)
        self._makes_command = owns_the_interface(config)
        if self._makes_command:
            self.subscribe_to(MEASUREMENT, self._on_measurement, begins_test=False)
        self.subscribe_to(CORRECTED_FORCE, self._on_corrected_force)
        self._misses_told = self._slow_told = 0

    def give_up_topics(self) -> None:
        """Give up the process that integrates, too."""
        super().give_up_topics()
        self._end_integration()

    def destroy_node(self) -> None:
        """Give up the process that integrates, too."""
        self._end_integration()
        super().destroy_node()

    def _end_integration(self) -> None:
        if self._integration is not None:
            self._integration.close()
            self._integration = None

    def reset_stage(self) -> None:
        """Return to rest before step 0."""
        self._conductor.reset()
        self._misses_told = self._slow_told = 0

    def shared_parameters(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the parameters and, because the name of a file says little, what the ground motion is."""
        return with_motion(super().shared_parameters(), self._motion)

    def further_sections(self) -> tuple[str, ...]:
        """Return what an interface control is made from."""
        return sections_of_compensator(self.config) if owns_the_interface(self.config) else ()

    @property
    def drives(self) -> bool:
        """True while a test runs."""
        return self.state is NodeState.RUNNING

    def on_disturbance(self, problem: str) -> None:
        """End the test."""
        if self.state is NodeState.RUNNING:
            self._conductor.end(Outcome.FAILED, problem, time.perf_counter())
            self._tell_changes()

    def stop_stage(self) -> None:
        """End a test that is under way."""
        if self.configured and self.state is NodeState.RUNNING:
            self._conductor.end(Outcome.STOPPED, "stopped by the operator", time.perf_counter())
            self._tell_changes()

    def status_values(self) -> dict[str, str]:
        """Tell progress, deadlines, and at the end the outcome."""
        if not self.configured or self.state is NodeState.INACTIVE:
            return {}
        conductor = self._conductor
        timing = conductor.deadlines.statistics()
        values = {
            "step": str(conductor.step),
            "steps": str(conductor.steps),
            "clock": "lockstep" if self.config.run.lockstep else "real time",
            "missed_deadlines": str(timing.missed_deadlines),
            "max_consecutive_misses": str(timing.max_consecutive_misses),
            "late_ticks": str(timing.late_ticks),
            **{f"closure_ms_{name}": repr(value) for name, value in timing.closure_ms.items()},
            "closure_counts": json.dumps(timing.closure_counts),
            "stability_indicator": f"{self._stability_indicator.value:.3g}",
            "outcome": str(conductor.outcome or ""),
            "waiting_for": ", ".join(conductor.waiting_for),
        }
        if self._integration is not None:
            values["slow_integrations"] = str(self._integration.slow)
            values["longest_integration_ms"] = f"{1e3 * self._integration.longest:.3g}"
        if conductor.trips:
            values["trip"] = str(conductor.trips[-1])
        values |= self.urgent_values()
        if conductor.outcome is not None:
            values["missed_steps"] = json.dumps(timing.missed_steps)
        return values

    def urgent_values(self) -> dict[str, str]:
        """Tell what the end asks of the table."""
        ended_by_limit = self.configured and self._conductor.outcome is Outcome.LIMIT
        return {"action": self._conductor.action.name.lower()} if ended_by_limit else {}

    def poll(self, now: float) -> float:
        """Let the conductor do what is due, and tell what has come of it."""
        if not self.configured or self.state is NodeState.INACTIVE:
            return math.inf
        ready = self.state is NodeState.READY and not self.agreement.obstacle(now)
        due = self._conductor.poll(now, ready)
        self._tell_changes()
        return due

    # ---- the operator

    def operator_services(self) -> Mapping[str, Callable[[], str]]:
        """Offer the operator the next test."""
        return {NEXT_TEST: self._on_next_test}

    def on_told(self, peer: NodeStatus) -> None:
        """Keep what table driver and recorder say, also while they are in no test."""
        self._told[peer.role] = peer
        if peer.role == TABLE_DRIVER and "table" in peer.values:
            self._table_moves = peer.values["table"] == "moving"

    def _on_next_test(self) -> str:
        """Offer a new test to the nodes, which begins when all of them are ready for it."""
        if problem := self._why_no_next_test():
            raise Refused(problem)
        try:
            self.reset_stage()
        except InputError as error:
            raise Refused(str(error)) from error
        self.take_part()
        return f"the next test, {self.agreement.run}, begins when every node is ready"

    def _why_no_next_test(self) -> str:
        """Return why the operator gets no new test now; empty when nothing is in the way."""
        if self.state is not NodeState.ENDED:
            return {
                NodeState.INACTIVE: "the numerical substructure is inactive; activate it",
                NodeState.RUNNING: f"a test is running; {STOP} of the table driver ends it",
            }.get(self.state, "a test is about to begin already")
        for role in (TABLE_DRIVER, RECORDER) if self.config.run.record else (TABLE_DRIVER,):
            told = self._told.get(role)
            if told is not None and told.state is NodeState.TRIPPED:
                way_out = f"{RESET} arms it again" if role == TABLE_DRIVER else "deactivate and activate it"
                return f"{role} has tripped ({told.message}); {way_out}"
        if self._table_moves:
            return "the table is still on its way to rest"
        recorder = self._told.get(RECORDER)
        if self.config.run.record and recorder is not None and recorder.state in (NodeState.WAITING, NodeState.READY):
            return "the bag of the last test is not closed yet"
        return ""

    # ---- the loop

    def _on_step(self, begun: Begun) -> None:
        desired = begun.desired_acceleration
        self._send_desired_acceleration(begun.step, (desired, begun.command) if self._makes_command else desired)
        self._send_required_force(begun.step, begun.required_force)
        self._send_ground_acceleration(begun.step, begun.ground_acceleration)

    def _on_measurement(self, step: int, measurement: TableMeasurement) -> None:
        self._conductor.measured(measurement, time.perf_counter())

    def _on_corrected_force(self, step: int, force: float) -> None:
        self._conductor.shear(step, force, time.perf_counter())

    def on_peer(self, peer: NodeStatus) -> None:
        """Let the conductor judge it."""
        told = peer.values.get("recorded_steps", "")
        outcome = peer.values.get("outcome", "")
        self._conductor.hear(
            Peer(
                peer.role,
                peer.state,
                peer.message,
                Outcome(outcome) if outcome in set(Outcome) else None,
                int(told) if told.isdecimal() else 0,
            ),
            time.perf_counter(),
        )
        if self.state is not NodeState.INACTIVE:
            self._tell_changes()

    def _tell_changes(self) -> None:
        """Tell what has changed since the last time."""
        conductor = self._conductor
        misses = conductor.deadlines.missed_deadlines
        slow = 0 if self._integration is None else self._integration.slow
        if conductor.state is NodeState.RUNNING:
            if self.state is not NodeState.RUNNING:
                self.set_state(NodeState.RUNNING)
            elif misses > self._misses_told:
                self.level, self.note = status.WARN, f"{misses} deadlines missed, the last at step {conductor.step - 1}"
                self.status_due_within(MISS_REPORT_PERIOD)
            elif slow > self._slow_told:
                self.level, self.note = status.WARN, f"{slow} integrations took too long, 60 % of their steps or more"
                self.status_due_within(MISS_REPORT_PERIOD)
            self._misses_told, self._slow_told = misses, slow
        elif conductor.state is NodeState.ENDED and self.state is not NodeState.ENDED:
            well = conductor.outcome in (Outcome.FINISHED, Outcome.STOPPED)
            self.set_state(NodeState.ENDED, conductor.reason, status.OK if well else status.ERROR)
            timing = conductor.deadlines.statistics()
            closure = ", ".join(f"{name} {value:.2f}" for name, value in timing.closure_ms.items())
            deadlines = f"{timing.missed_deadlines} of {conductor.step} deadlines missed"
            self.log_later(f"{conductor.outcome}: {conductor.reason}; {deadlines}, closure [ms] {closure}")
            if self._integration is not None and self._integration.count:
                self._log_integrations(self._integration)

    def _log_integrations(self, integration: IntegrationProcess) -> None:
        """Log how long the integrations took, as a warning where some took too long."""
        told = f"{integration.slow} of {integration.count} integrations took 60 % of their steps or more"
        level = status.WARN if integration.slow else status.OK
        self.log_later(f"{told}, the longest {1e3 * integration.longest:.3g} ms", level)


def main() -> int:
    """Run the node."""
    return run_nodes([NumericalSubstructureNode])


if __name__ == "__main__":
    sys.exit(main())
