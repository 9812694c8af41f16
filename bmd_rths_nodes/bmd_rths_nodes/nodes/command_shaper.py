"""Command shaper: desired acceleration in, acceleration command out."""

from __future__ import annotations

import sys

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_command_shaper, sections_of_compensator
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_msgs_py.topics import COMMAND, COMMAND_SHAPER, DESIRED_ACCELERATION, MEASUREMENT
from bmd_rths_nodes.ros.messages import owns_the_interface, shaper_learns
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode


class CommandShaperNode(StageNode):
    """Node around the `Shaper` of the compensator; it passes on what an interface control commands."""

    ROLE = COMMAND_SHAPER

    def configure_stage(self, config: Config) -> None:
        """Make stage and topics."""
        self._stage = make_command_shaper(config)
        self._lockstep = config.run.lockstep
        self._learns = shaper_learns(config)
        self._send_command = self.publish_to(COMMAND)
        self._forget()
        if self._learns:
            self.subscribe_to(MEASUREMENT, self._on_measurement, begins_test=False)
        on_desired = self._on_desired_and_command if owns_the_interface(config) else self._on_desired_acceleration
        self.subscribe_to(DESIRED_ACCELERATION, on_desired)

    def reset_stage(self) -> None:
        """Forget the past."""
        self._stage.reset()
        self._forget()

    def further_sections(self) -> tuple[str, ...]:
        """Return what the shaper is made from."""
        return () if owns_the_interface(self.config) else sections_of_compensator(self.config)

    def _forget(self) -> None:
        self._shaped = self._learnt = -1
        self._waiting: tuple[int, float] | None = None

    def _on_desired_acceleration(self, step: int, desired_acceleration: float) -> None:
        if self._learns and self._lockstep and self._learnt < step - 1:
            self._waiting = (step, desired_acceleration)  # its measurement, which comes by another way, is late
        else:
            self._shape(step, desired_acceleration)

    def _on_measurement(self, step: int, measurement: TableMeasurement) -> None:
        if step == self._shaped:
            self._stage.learn(measurement)
            self._learnt = step
        if self._waiting is not None and self._waiting[0] == step + 1:
            waiting, self._waiting = self._waiting, None
            self._shape(*waiting)

    def _shape(self, step: int, desired_acceleration: float) -> None:
        self._shaped = step
        self._send_command(step, self._stage.step(desired_acceleration))

    def _on_desired_and_command(self, step: int, values: tuple[float, float]) -> None:
        self._send_command(step, self._stage.step(values[1]))


def main() -> int:
    """Run the node."""
    return run_nodes([CommandShaperNode])


if __name__ == "__main__":
    sys.exit(main())
