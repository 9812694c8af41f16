"""When a test is over for every node of it: it has ended, the table is at rest, and the bag is closed."""

from __future__ import annotations

import math

from bmd_rths_core.loop.states import NodeState, Outcome
from bmd_rths_msgs_py.node_status import NodeStatus
from bmd_rths_msgs_py.topics import NUMERICAL_SUBSTRUCTURE, RECORDER, TABLE_DRIVER

#: A process stays for this long after the test is over [s]: what it told last has to reach the others.
LINGER = 1.0


class EndOfTest:
    """What the nodes of a test tell of its end.

    Parameters
    ----------
    recorded : bool
        The test has a recorder, whose bag has to be closed.

    Attributes
    ----------
    outcome : str
        How the test has ended; empty before.
    """

    def __init__(self, recorded: bool) -> None:
        self.outcome = ""
        self._waits_for_bag = recorded
        self._table_moves = False
        self._over_since = math.inf

    def hear(self, status: NodeStatus) -> None:
        """Take a status of a node of the test, the own one too; one that tells only what is urgent leaves things out.

        Parameters
        ----------
        status : NodeStatus
            The status.
        """
        if status.role == NUMERICAL_SUBSTRUCTURE and status.state is NodeState.ENDED:
            self.outcome = status.values.get("outcome", self.outcome)
        elif status.role == TABLE_DRIVER and "table" in status.values:
            self._table_moves = status.values["table"] == "moving"
        elif status.role == RECORDER and status.state in (NodeState.ENDED, NodeState.TRIPPED):
            self._waits_for_bag = False

    def over(self, now: float) -> bool:
        """Tell whether there is nothing more to wait for.

        Parameters
        ----------
        now : float
            Time of `time.perf_counter` [s].
        """
        if not self.outcome or self._table_moves or self._waits_for_bag:
            self._over_since = math.inf
            return False
        self._over_since = min(self._over_since, now)
        return now >= self._over_since + LINGER

    @property
    def exit_status(self) -> int:
        """Exit status that says how the test has ended: 0 when the whole ground motion was run."""
        return 0 if self.outcome == Outcome.FINISHED else 1
