"""The five nodes of the loop in one process with one executor."""

from __future__ import annotations

import sys

from bmd_rths_nodes.command_shaper_node import CommandShaperNode
from bmd_rths_nodes.force_correction_node import ForceCorrectionNode
from bmd_rths_nodes.numerical_substructure_node import NumericalSubstructureNode
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.shear_estimator_node import ShearEstimatorNode
from bmd_rths_nodes.table_driver_node import TableDriverNode

LOOP_NODES = (
    NumericalSubstructureNode,
    CommandShaperNode,
    TableDriverNode,
    ShearEstimatorNode,
    ForceCorrectionNode,
)


def main() -> int:
    """Run the nodes."""
    return run_nodes(LOOP_NODES)


if __name__ == "__main__":
    sys.exit(main())
