"""Table driver: command in, through the limits to the table controller, measurement out."""

from __future__ import annotations

import sys

from bmd_rths_core.assembly import make_command_limit, make_table_controller
from bmd_rths_core.config import Config
from bmd_rths_core.safety import LimitExceeded
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_msgs_py.topics import COMMAND, MEASUREMENT, NUMERICAL_SUBSTRUCTURE, TABLE_DRIVER
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.spin import run_nodes
from bmd_rths_nodes.ros.stage_node import StageNode
from bmd_rths_nodes.ros.status import NodeStatus


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
        self._outcome = ""
        self._moving = self._ended = False
        self.subscribe_to(COMMAND, self._on_command)
        self.listen_to_peers(self._on_peer)

    def reset_stage(self) -> None:
        """Make the table ready for step 0."""
        self._outcome = ""
        self._moving = self._ended = False
        self._table.connect()

    def stop_stage(self) -> None:
        """Bring the table to rest and release it."""
        if self.configured:
            self._table.stop()
            self._table.close()

    def status_values(self) -> dict[str, str]:
        """Tell the controller, whether the table moves, and how a trip is to be counted."""
        values = {"controller": self.config.table.controller}
        if self.configured:
            values |= {"table": "moving" if self._moving else "at rest", "outcome": self._outcome}
        return values

    def _on_peer(self, peer: NodeStatus) -> None:
        """Stop the table when the test has ended; what is still on its way must not move it again."""
        if peer.role == NUMERICAL_SUBSTRUCTURE and peer.state in (status.ENDED, status.INACTIVE) and self._moving:
            self._ended = True
            self._moving = False
            self._table.stop()
            self.publish_status()

    def _on_command(self, step: int, command: float) -> None:
        if self._ended:
            return
        self._moving = True
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
        self._moving = False
        self._outcome = outcome
        self.get_logger().error(f"table stopped: {reason}")
        self.set_state(status.TRIPPED, reason, status.ERROR)


def main() -> int:
    """Run the node."""
    return run_nodes([TableDriverNode])


if __name__ == "__main__":
    sys.exit(main())
