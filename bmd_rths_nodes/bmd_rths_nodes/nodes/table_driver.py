"""Table driver: command in, through the supervisor to the table controller, measurement out."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.safety import Action, State, halt
from bmd_rths_core.table.controller import AsynchronousTableController, NoAnswer, TableCommand, TableMeasurement
from bmd_rths_msgs_py.topics import COMMAND, MEASUREMENT, NUMERICAL_SUBSTRUCTURE, TABLE_DRIVER
from bmd_rths_nodes.hardware.controllers import make_table_controller
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import STATUS_PERIOD, StageNode
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.ros.triggers import EMERGENCY_STOP, RESET, STOP, Refused

#: Time between two looks at a table driver that gets no command [s].
SILENCE_PERIOD = 0.05

#: Time between two looks at an answer that has not come [s]; all but 0.3 ms of it is a wait in the middleware.
ANSWER_PERIOD = 0.0005

#: What else than a ramp to rest the numerical substructure can ask for at the end of a test.
_ACTIONS_AT_THE_END = {action.name.lower(): action for action in (Action.HOLD, Action.EMERGENCY_STOP)}

#: What is told of the motion of the table, the acceleration as it is applied; each has a limit in the section safety.
_LIMITED = ("displacement", "acceleration", "force")


class TableDriverNode(StageNode):
    """Node around a `bmd_rths_core.table.controller.TableController`, simulated or real.

    The safety supervisor looks at every command and measurement. When it refuses a command, or no command comes any
    more, or the operator asks for it, the node trips, brings the table to rest, and nothing moves until it is reset or
    activated again. At the end of every test the table is brought to rest in the same way. A step that the controller
    does not answer has no measurement, so that it misses its deadline. In real time the node does not wait for an
    answer when the controller is an `AsynchronousTableController`: newer commands and the supervisor go on.
    """

    ROLE = TABLE_DRIVER
    SECTIONS = ("run", "safety", "table", "simulated_table", "specimen")

    _advance_due = _silence_due = math.inf
    _test_runs_until = 0.0
    _asynchronous: AsynchronousTableController | None = None

    def configure_stage(self, config: Config) -> None:
        """Make controller, supervisor and topics."""
        self._supervisor = make_supervisor(config)
        self._table = make_table_controller(config)
        self._asynchronous = self._table if isinstance(self._table, AsynchronousTableController) else None
        self._period = config.run.time_step
        self._send_measurement = self.publish_to(MEASUREMENT)
        self._forget_the_last_test()
        self.subscribe_to(COMMAND, self._on_command, newest_only=config.table.controller != "simulated")
        self.listen_to_peers(self._on_peer)

    def reset_stage(self) -> None:
        """Make the table ready for step 0."""
        self._forget_the_last_test()
        try:
            self._table.connect()
        except (OSError, RuntimeError) as error:
            if self.state not in (status.WAITING, status.READY):
                raise InputError(f"table controller: {error}") from error
            self._supervisor.request(Action.EMERGENCY_STOP)  # a new test with the same processes
            self._trip("failed", f"table controller: {error}")

    def _forget_the_last_test(self) -> None:
        self._supervisor.reset()
        self._outcome = ""
        self._moving = self._ended = False
        self._command_time = 0.0
        self._motion = self._peaks = (0.0,) * len(_LIMITED)
        self._last_step = self._last_passed = -1
        self._silence_due = self._advance_due = math.inf

    def stop_stage(self) -> None:
        """Bring the table to rest and release it."""
        if not self.configured:
            return
        if self._moving:
            self._supervisor.request(Action.RAMP)
            self._begin_the_way_to_rest()
        while self._moving:
            time.sleep(max(0.0, self._advance_due - time.perf_counter()))
            if self.ending is not None and self.ending.hurried and not self._supervisor.emergency:
                self._supervisor.request(Action.EMERGENCY_STOP)
                self._trip("stopped", "emergency stop by the operator")
            self._look_for_answers(time.perf_counter())
            self._advance()
        halt(self._table, self._supervisor)
        self._table.close()

    def status_values(self) -> dict[str, str]:
        """Tell the controller, what the table does, every trip, and how a trip is to be counted."""
        values = {"controller": self.config.table.controller}
        if self.configured:
            values |= {
                "table": "moving" if self._moving and not self._supervisor.at_rest else "at rest",
                "supervisor": self._supervisor.state.value,
                "trips": " | ".join(str(trip) for trip in self._supervisor.trips),
                "outcome": self._outcome,
                **self._motion_and_limits(),
                **self._table.statistics(),
            }
        return values

    def _motion_and_limits(self) -> dict[str, str]:
        """Return what the table does, what it did at most in this test, and what it may do."""
        limits = self.config.safety
        values: dict[str, str] = {}
        for name, now, peak in zip(_LIMITED, self._motion, self._peaks, strict=True):
            values |= {name: f"{now:.6g}", f"peak_{name}": f"{peak:.6g}"}
            values[f"{name}_limit"] = repr(getattr(limits, f"{name}_limit"))
        return values

    def poll(self, now: float) -> float:
        """Send the next command on the way to rest, and notice when no command comes any more."""
        answer_due = self._look_for_answers(now)
        if now >= self._advance_due:
            self._advance()
        elif now >= self._silence_due:
            self._silence_due = now + SILENCE_PERIOD
            self._supervisor.silence(int((now - self._command_time) / self.config.run.time_step) - 1)
            if not self._supervisor.passing:
                self._trip("limit", self._supervisor.reason)
        return min(super().poll(now), self._advance_due, self._silence_due, answer_due)

    def on_disturbance(self, problem: str) -> None:
        """Bring the table to rest."""
        self._supervisor.request(Action.RAMP)
        self._trip("failed", problem)

    def operator_services(self) -> Mapping[str, Callable[[], str]]:
        """Offer the operator stop, emergency stop and reset."""
        return {STOP: self._on_stop, EMERGENCY_STOP: self._on_emergency_stop, RESET: self._on_reset}

    def _on_stop(self) -> str:
        """Ramp to rest. It is latched, also when nothing moves yet: no test begins before a reset."""
        self._refuse_when_inactive()
        if self.state not in (status.TRIPPED, status.ENDED):
            moves = self._moving
            self._supervisor.request(Action.RAMP)
            self._trip("stopped", "stopped by the operator")
            if not moves:
                return "the table is at rest; no test begins before a reset"
            return f"the table is brought to rest, {self._since()}"
        if self._supervisor.state is State.HOLDING:
            self._supervisor.request(Action.RAMP)
            return "the hold has ended; the table is brought back to zero displacement"
        return "the table is on its way to rest already" if self._moving else "the table is at rest already"

    def _on_emergency_stop(self) -> str:
        """Stop the table by the fastest way it has, whatever it is doing."""
        self._refuse_when_inactive()
        self._supervisor.request(Action.EMERGENCY_STOP)
        self._trip("stopped", "emergency stop by the operator")
        self._advance()
        return f"emergency stop: the table controller was told to stop at once, {self._since()}"

    def _on_reset(self) -> str:
        """Arm again for a new test, as an activation does."""
        self._refuse_when_inactive()
        if time.perf_counter() < self._test_runs_until:
            raise Refused("a test is running; stop it first")
        if self._supervisor.state is State.HOLDING:
            raise Refused(f"the table is held off zero displacement; {STOP} brings it back first")
        if self._moving:
            raise Refused("the table is still on its way to rest")
        if self.state != status.TRIPPED:
            raise Refused(f"there is nothing to reset: the table driver is {self.state}")
        try:
            self._table.connect()
        except (OSError, RuntimeError) as error:
            raise Refused(f"table controller: {error}") from error
        self._forget_the_last_test()
        self.expect_a_new_test()
        return "armed for a new test"

    def _refuse_when_inactive(self) -> None:
        if self.state == status.INACTIVE:
            raise Refused("the table driver is inactive; it moves nothing")

    def _since(self) -> str:
        return f"after step {self._last_passed}" if self._last_passed >= 0 else "before step 0"

    def _on_peer(self, peer: NodeStatus) -> None:
        """Bring the table to rest when the test has ended; what is still on its way must not move it again."""
        if peer.role != NUMERICAL_SUBSTRUCTURE:
            return
        # A numerical substructure that is gone has no test any more.
        self._test_runs_until = time.perf_counter() + 2.0 * STATUS_PERIOD if peer.state == status.RUNNING else 0.0
        ended = peer.state in (status.ENDED, status.INACTIVE)
        if ended and self._moving and self._advance_due == math.inf:
            self._supervisor.request(_ACTIONS_AT_THE_END.get(peer.values.get("action", ""), Action.RAMP))
            self._ended = True
            self._begin_the_way_to_rest()
            self.set_state(status.ENDED, "bringing the table to rest")

    def _on_command(self, step: int, command: float) -> None:
        if self._ended:
            return
        self._moving = True
        self._command_time = now = time.perf_counter()
        if not self.config.run.lockstep:
            # The loop waits for nobody in real time: a command that does not come is missed.
            self._silence_due = now + (self.config.safety.stale_shear_limit + 2) * self.config.run.time_step
        if not self._supervisor.check(step, command):
            self._trip("limit", self._supervisor.reason)
        else:
            self._last_passed = step
            self._move(TableCommand(step, command))

    def _move(self, command: TableCommand) -> None:
        """Move the table for one step; its measurement comes now, later, or not at all."""
        self._last_step = command.step
        try:
            if self._asynchronous is None or self.config.run.lockstep:
                self._on_measurement(self._table.exchange(command))
            else:
                self._asynchronous.begin(command)
        except NoAnswer:
            return
        except (OSError, RuntimeError) as error:
            self._fail(error)

    def _look_for_answers(self, now: float) -> float:
        """Take the measurements that have come without waiting for them, and return when to look again."""
        if self._asynchronous is None:
            return math.inf
        try:
            while (measurement := self._asynchronous.poll()) is not None:
                self._on_measurement(measurement)
        except (OSError, RuntimeError) as error:
            self._fail(error)
        return now + ANSWER_PERIOD if self._asynchronous.awaiting else math.inf

    def _on_measurement(self, measurement: TableMeasurement) -> None:
        self._supervisor.observe(measurement)
        if measurement.step <= self._last_passed:  # the way to rest is no part of the test
            self._send_measurement(measurement.step, measurement)
        self._motion = (measurement.table_displacement, measurement.applied_command, measurement.actuator_force)
        # What is not measured is NaN, which is not larger than the peak.
        self._peaks = tuple(max(peak, abs(value)) for peak, value in zip(self._peaks, self._motion, strict=True))

    def _fail(self, error: Exception) -> None:
        """Stop the table as fast as it can, because its controller cannot go on."""
        self._supervisor.request(Action.EMERGENCY_STOP)
        step = f" at step {self._last_step}" if self._moving else ""
        self._trip("failed", f"table controller{step}: {error}")

    def _trip(self, outcome: str, reason: str) -> None:
        self._outcome = self._outcome or outcome
        self._begin_the_way_to_rest()
        self.get_logger().error(f"table is stopped: {reason}")
        self.set_state(status.TRIPPED, reason, status.WARN if outcome == "stopped" else status.ERROR)

    def _begin_the_way_to_rest(self) -> None:
        self._silence_due = math.inf
        if self._advance_due == math.inf:
            at_once = self.config.run.lockstep or self._supervisor.at_rest
            self._advance_due = time.perf_counter() if at_once else self._command_time + self._period

    def _advance(self) -> None:
        """Send one command on the way to rest; at its end release the table, except after a hold."""
        command = self._supervisor.advance()
        if command is not None:
            self._move(command)
        if self._supervisor.state is not State.STOPPED:
            # Each command is held for a full step; in lockstep only a hold that has come to rest waits.
            if not self.config.run.lockstep or self._supervisor.at_rest:
                self._advance_due = max(self._advance_due + self._period, time.perf_counter())
            return
        halt(self._table, self._supervisor)
        self._moving = False
        self._advance_due = math.inf
        if self.state == status.ENDED:
            self.set_state(status.WAITING)
        else:
            self.publish_status()


def main() -> int:
    """Run the node."""
    return run_nodes([TableDriverNode])


if __name__ == "__main__":
    sys.exit(main())
