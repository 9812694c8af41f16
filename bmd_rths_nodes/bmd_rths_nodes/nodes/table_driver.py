"""Table driver: command in, through the supervisor to the table controller, measurement out."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_calibration, make_supervisor
from bmd_rths_core.loop.states import DriveState, NodeState, Outcome
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.safety import Action, State
from bmd_rths_core.table.controller import TableCommand, TableController, TableMeasurement
from bmd_rths_msgs_py.topics import (
    COMMAND,
    MEASUREMENT,
    NUMERICAL_SUBSTRUCTURE,
    TABLE_DRIVER,
    WAY_TO_REST_COMMAND,
    WAY_TO_REST_MEASUREMENT,
)
from bmd_rths_nodes.hardware.controllers import make_table_controller
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import STATUS_PERIOD, StageNode
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.ros.triggers import EMERGENCY_STOP, RESET, STOP, Refused

#: What else than a ramp to rest the numerical substructure can ask for at the end of a test.
_ACTIONS_AT_THE_END = {action.name.lower(): action for action in (Action.HOLD, Action.EMERGENCY_STOP)}

#: What is told of the motion of the table, the acceleration as it is applied; each has a limit in the section safety.
_LIMITED = ("displacement", "acceleration", "force")


#: A call of the emergency stop this soon after the last one is answered by that one [s].
EMERGENCY_PERIOD = 0.1


class TableDriverNode(StageNode):
    """Host of `bmd_rths_core.loop.table_driver.TableDriver` and its table controller, simulated or real.

    It converts and publishes; what is passed to the table, and what is not, is decided in the core. Every trip is told
    at once, and logged when the table is at rest.
    """

    ROLE = TABLE_DRIVER
    SERVICES = (STOP, EMERGENCY_STOP, RESET)

    _driver: TableDriver
    _test_runs_until = 0.0
    _test_is_over = False
    _stray_told = False

    def make_table(self, config: Config) -> TableController:
        """Return the table controller, not connected yet; a driver of somebody else has one of its own."""
        return make_table_controller(config)

    def configure_stage(self, config: Config) -> None:
        """Make controller, supervisor and topics."""
        self._table = self.make_table(config)
        self._driver = TableDriver(
            self._table,
            make_supervisor(config),
            config.run.time_step,
            config.run.lockstep,
            self._on_measurement,
            self._on_rest_command,
            self._on_rest_measurement,
            make_calibration(config),
        )
        self._send_measurement = self.publish_to(MEASUREMENT)
        self._send_rest_command = self.publish_to(WAY_TO_REST_COMMAND, at_once=True)
        self._send_rest_measurement = self.publish_to(WAY_TO_REST_MEASUREMENT, at_once=True)
        self._forget_the_last_test()
        self.subscribe_to(COMMAND, self._on_command, newest_only=config.table.controller != "simulated")

    def reset_stage(self) -> None:
        """Make the table ready for step 0."""
        if self._driver.moving:  # of a bag that is played, say: it must not make the driver forget its table
            self.on_disturbance("another test begins while the table moves")
            return
        self._forget_the_last_test()
        try:
            self._driver.arm()
        except (OSError, RuntimeError) as error:
            reason = f"table controller: {error}"
            if self.state not in (NodeState.WAITING, NodeState.READY):
                raise InputError(reason) from error
            self._driver.stop(Action.EMERGENCY_STOP, Outcome.FAILED, reason, time.perf_counter())
            self._tell_changes()

    def _forget_the_last_test(self) -> None:
        self._told: tuple[DriveState, str, str] = (DriveState.ARMED, "", "")
        self._test_ended = False
        self._emergency_told = -math.inf
        self._peaks = (0.0,) * len(_LIMITED)

    def stop_stage(self) -> None:
        """Bring the table to rest and release it."""
        if not self.configured:
            return
        try:
            self._bring_to_rest()
        finally:  # a controller of somebody else may raise anything; it is asked to stop the table all the same
            self._driver.release()
        self._tell_changes()

    def _bring_to_rest(self) -> None:
        driver = self._driver
        if driver.moving:
            driver.finish(Action.RAMP, time.perf_counter())
        while driver.moving and driver.state is not DriveState.HELD:
            if self.ending is not None and self.ending.hurried and not driver.supervisor.emergency:
                reason = "emergency stop by the operator"
                driver.stop(Action.EMERGENCY_STOP, Outcome.STOPPED, reason, time.perf_counter())
            due = driver.poll(time.perf_counter())
            time.sleep(min(max(0.0, due - time.perf_counter()), self.config.run.time_step))

    def status_values(self) -> dict[str, str]:
        """Tell the controller, what the table does, every trip, and how a trip is to be counted."""
        values = {"controller": self.config.table.controller}
        if self.configured:
            driver = self._driver
            values |= {
                "table": self._table_in_words(),
                "stop_problem": driver.stop_problem,
                "supervisor": driver.supervisor.state.value,
                "trips": " | ".join(str(trip) for trip in driver.supervisor.trips),
                **self.urgent_values(),
                **self._motion_and_limits(),
                **self._table.statistics(),
            }
        return values

    def _table_in_words(self) -> str:
        if self._driver.stop_problem:
            return "not known to be at rest"
        return "moving" if self._driver.moving and not self._driver.supervisor.at_rest else "at rest"

    def urgent_values(self) -> dict[str, str]:
        """Tell how the driver ended the test."""
        return {"outcome": str(self._driver.outcome or "")} if self.configured else {}

    def _motion_and_limits(self) -> dict[str, str]:
        """Return what the table does, what it did at most since the test began, and what it may do."""
        limits = self.config.safety
        values: dict[str, str] = {}
        latest = self._driver.latest
        motion = (0.0,) * len(_LIMITED) if latest is None else _motion(latest)
        for name, value, peak in zip(_LIMITED, motion, self._peaks, strict=True):
            values |= {name: f"{value:.6g}", f"peak_{name}": f"{peak:.6g}"}
            values[f"{name}_limit"] = repr(getattr(limits, f"{name}_limit"))
        return values

    def poll(self, now: float) -> float:
        """Let the driver do what is due, and tell what has come of it."""
        if not self.configured:
            return math.inf
        due = self._driver.poll(now)
        self._tell_changes()
        return due

    @property
    def drives(self) -> bool:
        """True while the table moves."""
        return self.configured and self._driver.state in (DriveState.FOLLOWING, DriveState.RETURNING)

    def on_disturbance(self, problem: str) -> None:
        """Bring the table to rest."""
        self._driver.stop(Action.RAMP, Outcome.FAILED, problem, time.perf_counter())
        self._tell_changes()

    # ---- the operator

    def operator_services(self) -> Mapping[str, Callable[[], str]]:
        """Offer the operator stop, emergency stop and reset."""
        return {STOP: self._on_stop, EMERGENCY_STOP: self._on_emergency_stop, RESET: self._on_reset}

    def _on_stop(self) -> str:
        """Ramp to rest. It is latched, also when nothing moves yet: no test begins before a reset."""
        self._refuse_when_inactive()
        driver, now = self._driver, time.perf_counter()
        if self.state not in (NodeState.TRIPPED, NodeState.ENDED):
            moves = driver.moving
            driver.stop(Action.RAMP, Outcome.STOPPED, "stopped by the operator", now)
            self._tell_changes()
            if not moves:
                return "the table is at rest; no test begins before a reset"
            return f"the table is brought to rest, {self._since()}"
        held, latched = driver.supervisor.state is State.HOLDING, ""
        if self.state is NodeState.ENDED:
            driver.stop(Action.RAMP, Outcome.STOPPED, "stopped by the operator", now)
            self._tell_changes()
            latched = "; no test begins before a reset"
        elif held:
            driver.finish(Action.RAMP, now)
        if held:
            return f"the hold has ended; the table is brought back to zero displacement{latched}"
        if driver.moving:
            return f"the table is on its way to rest already{latched}"
        return driver.stop_problem or "the table is at rest already"

    def _on_emergency_stop(self) -> str:
        """Stop the table by the fastest way it has, whatever it is doing."""
        self._refuse_when_inactive()
        driver = self._driver
        may_move = driver.moving or driver.state is DriveState.ARMED
        # A controller that is silent is waited for; calls that have come meanwhile do not wait for it one by one.
        if may_move or time.perf_counter() > self._emergency_told + EMERGENCY_PERIOD:
            reason = "emergency stop by the operator"
            driver.stop(Action.EMERGENCY_STOP, Outcome.STOPPED, reason, time.perf_counter())
            self._tell_changes()
            self._emergency_told = time.perf_counter()
        told = f"emergency stop: the table controller was told to stop at once, {self._since()}"
        return f"{told}; {driver.stop_problem}" if driver.stop_problem else told

    def _on_reset(self) -> str:
        """Arm again for a new test, as an activation does."""
        self._refuse_when_inactive()
        if time.perf_counter() < self._test_runs_until:
            raise Refused("a test is running; stop it first")
        if self._driver.supervisor.state is State.HOLDING:
            raise Refused(f"the table is held off zero displacement; {STOP} brings it back first")
        if self._driver.moving:
            raise Refused("the table is still on its way to rest")
        if self.state is not NodeState.TRIPPED:
            raise Refused(f"there is nothing to reset: the table driver is {self.state}")
        try:
            self._driver.arm()
        except (OSError, RuntimeError) as error:
            raise Refused(f"table controller: {error}") from error
        self._forget_the_last_test()
        self.take_part()
        return "armed for a new test"

    def _refuse_when_inactive(self) -> None:
        if self.state is NodeState.INACTIVE:
            raise Refused("the table driver is inactive; it moves nothing")

    def _since(self) -> str:
        step = self._driver.last_passed
        return f"after step {step}" if step >= 0 else "before step 0"

    # ---- the loop

    @property
    def free(self) -> bool:
        """True when the table stands and no trip is latched."""
        return super().free and not (self.configured and self._driver.moving)

    def takes(self, topic: str) -> bool:
        """Take the commands of a test that was agreed on, until it ends; nobody else moves the table."""
        agreed = bool(self.agreement.run)
        taking_part = super().takes(topic)
        if taking_part and not agreed and not self._stray_told:
            self._stray_told = True
            self.log_later(f"{topic} dropped: {NUMERICAL_SUBSTRUCTURE} has offered no test it could be of", status.WARN)
        return taking_part and agreed and not self._test_is_over

    def on_new_test(self) -> None:
        """Take the commands of this test from now on."""
        super().on_new_test()
        self._test_is_over = self._stray_told = False

    def on_peer(self, peer: NodeStatus) -> None:
        """Bring the table to rest when the test has ended; what is still on its way must not move it again."""
        if peer.role != NUMERICAL_SUBSTRUCTURE:
            return
        # A numerical substructure that is gone has no test any more.
        running = peer.state is NodeState.RUNNING
        self._test_runs_until = time.perf_counter() + 2.0 * STATUS_PERIOD if running else 0.0
        if peer.state not in (NodeState.ENDED, NodeState.INACTIVE):
            return
        self._test_is_over = True  # also of a driver that has got none of its commands yet
        action = _ACTIONS_AT_THE_END.get(peer.values.get("action", ""), Action.RAMP)
        severer = action is Action.EMERGENCY_STOP and self._driver.moving  # than what the driver has begun by itself
        if self._driver.state is DriveState.FOLLOWING or severer:
            self._test_ended = True
            # A table that moves is brought to rest before anything else. Of one that stands it is told first that the
            # test has ended, because the confirmation of its stop may take long.
            if action is not Action.EMERGENCY_STOP and self._driver.supervisor.stands:
                self._told = (DriveState.RETURNING, "", "")
                self.set_state(NodeState.ENDED, "bringing the table to rest")
            self._driver.finish(action, time.perf_counter())
            self._tell_changes()

    def _on_command(self, step: int, command: float) -> None:
        self._driver.command(step, command, time.perf_counter())
        if self._driver.state is not DriveState.FOLLOWING:
            self._tell_changes()

    def _on_measurement(self, measurement: TableMeasurement) -> None:
        self._send_measurement(measurement.step, measurement)
        self._note_peaks(measurement)

    def _on_rest_command(self, command: TableCommand) -> None:
        self._send_rest_command(command.step, command.acceleration)

    def _on_rest_measurement(self, measurement: TableMeasurement) -> None:
        self._send_rest_measurement(measurement.step, measurement)
        self._note_peaks(measurement)

    def _note_peaks(self, measurement: TableMeasurement) -> None:
        # What is not measured is NaN, which is not larger than the peak.
        motion = zip(self._peaks, _motion(measurement), strict=True)
        self._peaks = tuple(max(peak, abs(value)) for peak, value in motion)

    def _tell_changes(self) -> None:
        """Tell what has changed since the last time."""
        driver = self._driver
        if self.state is NodeState.INACTIVE:
            return
        told = (driver.state, driver.reason, driver.stop_problem)
        if told != self._told:
            self._told = told
            if driver.outcome is not None:
                level = status.WARN if driver.outcome is Outcome.STOPPED and not driver.stop_problem else status.ERROR
                self.log_later(f"table is stopped: {driver.reason}", level)
                if driver.stop_problem not in driver.reason:
                    self.log_later(driver.stop_problem, level)
                self.set_state(NodeState.TRIPPED, driver.reason, level)
            elif driver.state is DriveState.RETURNING:
                self.set_state(NodeState.ENDED, "bringing the table to rest")
            elif driver.state is DriveState.AT_REST and self._test_ended:
                self.set_state(NodeState.WAITING)
            else:
                self.publish_status()


def _motion(measurement: TableMeasurement) -> tuple[float, float, float]:
    return (measurement.table_displacement, measurement.applied_command, measurement.actuator_force)


def main() -> int:
    """Run the node."""
    return run_nodes([TableDriverNode])


if __name__ == "__main__":
    sys.exit(main())
