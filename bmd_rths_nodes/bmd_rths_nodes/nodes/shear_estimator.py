"""Shear estimator: measurement in, interface shear out."""

from __future__ import annotations

import sys

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_shear_estimator
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_msgs_py.topics import INTERFACE_FORCE, MEASUREMENT, SHEAR_ESTIMATOR
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode


class ShearEstimatorNode(StageNode):
    """Node around `bmd_rths_core.stages.shear_estimator.ShearEstimator`."""

    ROLE = SHEAR_ESTIMATOR

    def configure_stage(self, config: Config) -> None:
        """Make stage and topics."""
        self._stage = make_shear_estimator(config)
        self._send_interface_force = self.publish_to(INTERFACE_FORCE)
        self.subscribe_to(MEASUREMENT, self._on_measurement)

    def reset_stage(self) -> None:
        """Return to rest."""
        self._stage.reset()

    def _on_measurement(self, step: int, measurement: TableMeasurement) -> None:
        self._send_interface_force(step, self._stage.step(measurement))


def main() -> int:
    """Run the node."""
    return run_nodes([ShearEstimatorNode])


if __name__ == "__main__":
    sys.exit(main())
