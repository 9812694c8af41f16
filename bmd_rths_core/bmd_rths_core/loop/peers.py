"""The other nodes of a test: who is ready, who has left, who was not heard of, and how far the recorder is."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from bmd_rths_core.loop.states import NodeState, Outcome

#: A peer that tells nothing for this long is lost [s]; every node tells its status once a second.
PEER_LOST_AFTER = 5.0

#: States of a peer that has left a test.
_GONE = (NodeState.INACTIVE, NodeState.ENDED)


class Peer(NamedTuple):
    """What another node of the loop says of itself.

    Parameters
    ----------
    role : str
        Its role.
    state : NodeState
        What it does.
    reason : str
        Why, in one line.
    outcome : Outcome or None
        What it makes of the test when it has tripped.
    recorded_steps : int
        Steps that are recorded whole, of a recorder.
    """

    role: str
    state: NodeState
    reason: str = ""
    outcome: Outcome | None = None
    recorded_steps: int = 0

    @property
    def has_left(self) -> bool:
        """True when it takes no part in a test any more."""
        return self.state in _GONE


class Peers:
    """What is known of the peers of a test.

    Parameters
    ----------
    roles : collection of str
        Roles that have to be ready before step 0.
    recorder : str
        Role among them that records; empty when nobody does.

    Attributes
    ----------
    roles : frozenset of str
        As given.
    recorded_steps : int
        Steps that are recorded whole.
    """

    def __init__(self, roles: Collection[str], recorder: str) -> None:
        self.roles = frozenset(roles)
        self._recorder = recorder
        self._heard: dict[str, float] = {}
        self.reset()

    def reset(self) -> None:
        """Wait for all of them."""
        self._ready: set[str] = set()
        self.recorded_steps = 0

    def hear(self, peer: Peer, now: float) -> None:
        """Take note of what a peer says of itself.

        Parameters
        ----------
        peer : Peer
            The peer.
        now : float
            Time [s].
        """
        self._heard[peer.role] = now
        if peer.state is NodeState.READY:
            self._ready.add(peer.role)
        else:
            self._ready.discard(peer.role)
        if peer.role == self._recorder:
            self.recorded_steps = peer.recorded_steps

    @property
    def not_ready(self) -> list[str]:
        """Roles that are waited for."""
        return sorted(self.roles - self._ready)

    def silent(self, now: float) -> list[str]:
        """Return the roles of which nothing was heard for too long.

        Parameters
        ----------
        now : float
            Time [s].
        """
        return sorted(role for role in self.roles if now - self._heard[role] > PEER_LOST_AFTER)
