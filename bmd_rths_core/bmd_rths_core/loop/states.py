"""States of a test and of the nodes that run it, as types; their values are the words that travel and are shown."""

from __future__ import annotations

from enum import Enum


class Word(str, Enum):
    """A state whose value is its word on /diagnostics, in bags and on the screen."""

    def __str__(self) -> str:
        return str(self.value)


class Outcome(Word):
    """How a test ended."""

    FINISHED = "finished"  # the whole ground motion was run
    LIMIT = "limit"  # a limit was passed
    FAILED = "failed"  # something that the loop needs did not work
    STOPPED = "stopped"  # an operator, or a signal, asked for it


class NodeState(Word):
    """What a node does, in the order it goes through."""

    INACTIVE = "inactive"  # configured or not, but not taking part
    WAITING = "waiting"  # active, but not yet matched with all its peers
    READY = "ready"  # matched; the conductor starts when all are
    RUNNING = "running"  # a test is under way
    ENDED = "ended"  # the test is over, for the recorder: the bag is closed
    TRIPPED = "tripped"  # stopped itself; nothing moves until it is activated again


class DriveState(Word):
    """What the table driver does with the table."""

    RELEASED = "released"  # not connected
    ARMED = "armed"  # connected and at rest; the first command moves it
    FOLLOWING = "following"  # the commands of a test move it
    RETURNING = "returning"  # it is on its way to rest
    HELD = "held"  # it stands, off zero displacement, until the operator brings it back
    AT_REST = "at rest"  # stopped; nothing moves it before it is armed again
