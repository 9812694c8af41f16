"""Command shaper: desired acceleration in, acceleration command out."""

from __future__ import annotations

import sys

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_command_shaper
from bmd_rths_msgs_py.topics import COMMAND, COMMAND_SHAPER, DESIRED_ACCELERATION
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode


class CommandShaperNode(StageNode):
    """Node around `bmd_rths_core.compensators.phase_lead.CommandShaper`."""

    ROLE = COMMAND_SHAPER

    def configure_stage(self, config: Config) -> None:
        """Make stage and topics."""
        self._stage = make_command_shaper(config)
        self._send_command = self.publish_to(COMMAND)
        self.subscribe_to(DESIRED_ACCELERATION, self._on_desired_acceleration)

    def reset_stage(self) -> None:
        """Forget the past."""
        self._stage.reset()

    def _on_desired_acceleration(self, step: int, desired_acceleration: float) -> None:
        self._send_command(step, self._stage.step(desired_acceleration))


def main() -> int:
    """Run the node."""
    return run_nodes([CommandShaperNode])


if __name__ == "__main__":
    sys.exit(main())
