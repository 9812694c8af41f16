"""Table driver: command in, through the limits to the table controller, measurement out."""

from __future__ import annotations

import sys

from bmd_rths_core.assembly import make_command_limit, make_table_controller
from bmd_rths_core.config import Config
from bmd_rths_core.safety import LimitExceeded
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_msgs_py.topics import COMMAND, MEASUREMENT, TABLE_DRIVER
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode


class TableDriverNode(StageNode):
    """Node around a `bmd_rths_core.table.controller.TableController`, simulated or real.

    A command that passes a limit stops the table; the node then stays tripped, and nothing moves, until it is
    deactivated and activated again.
    """

    ROLE = TABLE_DRIVER
    SECTIONS = ("run", "safety", "table", "simulated_table", "specimen")

    def configure_stage(self, config: Config) -> None:
        """Make controller, limits and topics."""
        self._limit = make_command_limit(config)
        self._table = make_table_controller(config)
        self._send_measurement = self.publish_to(MEASUREMENT)
        self.subscribe_to(COMMAND, self._on_command)

    def reset_stage(self) -> None:
        """Make the table ready for step 0."""
        self._outcome = ""
        self._table.connect()

    def stop_stage(self) -> None:
        """Bring the table to rest and release it."""
        if self.configured:
            self._table.stop()
            self._table.close()

    def status_values(self) -> dict[str, str]:
        """Tell the controller, and how a trip is to be counted."""
        return {"controller": self.config.table.controller, "outcome": self._outcome if self.configured else ""}

    def _on_command(self, step: int, command: float) -> None:
        try:
            self._limit.step(step, command)
            measurement = self._table.exchange(TableCommand(step, command))
        except LimitExceeded as trip:
            self._trip("limit", str(trip))
        except (OSError, RuntimeError) as error:
            self._trip("failed", f"table controller at step {step}: {error}")
        else:
            self._send_measurement(step, measurement)

    def _trip(self, outcome: str, reason: str) -> None:
        self._table.stop()
        self._outcome = outcome
        self.get_logger().error(f"table stopped: {reason}")
        self.set_state(status.TRIPPED, reason, status.ERROR)


def main() -> int:
    """Run the node."""
    return run_nodes([TableDriverNode])


if __name__ == "__main__":
    sys.exit(main())
