"""Force correction: required force and interface shear in, corrected shear out."""

from __future__ import annotations

import sys

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_force_correction
from bmd_rths_msgs_py.topics import CORRECTED_FORCE, FORCE_CORRECTION, INTERFACE_FORCE, REQUIRED_FORCE
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode


class ForceCorrectionNode(StageNode):
    """Node around `bmd_rths_core.stages.force_correction.ForceCorrection`."""

    ROLE = FORCE_CORRECTION

    def configure_stage(self, config: Config) -> None:
        """Make stage and topics."""
        self._stage = make_force_correction(config)
        self._required = self._measured = (-1, 0.0)
        self._send_corrected_force = self.publish_to(CORRECTED_FORCE)
        self.subscribe_to(REQUIRED_FORCE, self._on_required_force)
        self.subscribe_to(INTERFACE_FORCE, self._on_interface_force)

    def reset_stage(self) -> None:
        """Forget the past; the two inputs of a step find each other by its index."""
        self._stage.reset()

    def _on_required_force(self, step: int, force: float) -> None:
        self._required = (step, force)
        self._correct_when_both_are_there()

    def _on_interface_force(self, step: int, force: float) -> None:
        self._measured = (step, force)
        self._correct_when_both_are_there()

    def _correct_when_both_are_there(self) -> None:
        step = self._measured[0]
        if self._required[0] == step:
            self._send_corrected_force(step, self._stage.step(self._required[1], self._measured[1]))


def main() -> int:
    """Run the node."""
    return run_nodes([ForceCorrectionNode])


if __name__ == "__main__":
    sys.exit(main())
