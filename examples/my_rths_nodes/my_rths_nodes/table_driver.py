"""A table driver of your own that keeps the supervisor: the one of bmd_rths, with a table of yours."""

import sys

from bmd_rths_nodes.nodes.table_driver import TableDriverNode
from bmd_rths_nodes.ros.spin import run_nodes
from my_rths_nodes.my_table import MyTable


class MyTableDriver(TableDriverNode):
    """Every command passes limits, way to rest and operator services as before; only the table is another one."""

    def make_table(self, config):
        """Return the table, which is not connected yet."""
        return MyTable(config)


def main():
    """Run the node."""
    return run_nodes([MyTableDriver])


if __name__ == "__main__":
    sys.exit(main())
