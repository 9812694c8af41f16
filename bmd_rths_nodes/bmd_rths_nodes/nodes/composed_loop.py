"""The five nodes of the loop in one process with one executor."""

from __future__ import annotations

import sys

from bmd_rths_nodes.nodes.command_shaper import CommandShaperNode
from bmd_rths_nodes.nodes.force_correction import ForceCorrectionNode
from bmd_rths_nodes.nodes.numerical_substructure import NumericalSubstructureNode
from bmd_rths_nodes.nodes.shear_estimator import ShearEstimatorNode
from bmd_rths_nodes.nodes.table_driver import TableDriverNode
from bmd_rths_nodes.ros.spin import run_nodes

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
