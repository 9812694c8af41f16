"""In which order the steps of each topic come to a node, and how many do not fit."""

from __future__ import annotations

from typing import NamedTuple

from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.cdr import MalformedMessage


class Taken(NamedTuple):
    """A step whose turn it is."""

    step: int
    begins_anew: bool  # step 0 after a later one, or the first one of a new test


class StepOrder:
    """Counts steps; a node takes each of them once, in their order.

    Parameters
    ----------
    stamps : StepStamps
        Of the steps.

    Attributes
    ----------
    steps, lost, out_of_order, malformed : int
        Messages that were taken, skipped, dropped because they came again or late, and dropped unread.
    """

    def __init__(self, stamps: StepStamps) -> None:
        self._stamps = stamps
        self.forget()

    def forget(self) -> None:
        """Begin to count anew."""
        self._expected: dict[str, int] = {}
        self._of_last_test: set[str] = set()
        self.steps = self.lost = self.out_of_order = self.malformed = 0

    def expect_new_test(self) -> None:
        """Take the next smaller step of each topic for one of a new test, whose step 0 may be lost or be repeated."""
        self._of_last_test = set(self._expected)

    def take(self, topic: str, stamp: int) -> Taken | None:
        """Take the step of a message.

        Parameters
        ----------
        topic : str
            Name of its topic.
        stamp : int
            Its stamp [ns].

        Returns
        -------
        Taken or None
            None for a step that was there before, or that a later one has overtaken.

        Raises
        ------
        MalformedMessage
            The stamp is that of no step.
        """
        index = self._stamps.step(stamp)
        if index is None:
            raise MalformedMessage(f"stamp {stamp} ns is not that of a step")
        expected = self._expected.get(topic, 0)
        begins_anew = (index < expected and topic in self._of_last_test) or (index == 0 and expected > 1)
        if begins_anew:
            self._of_last_test.discard(topic)
            expected = 0
        if index < expected:
            self.out_of_order += 1
            return None
        self.lost += index - expected
        self._expected[topic] = index + 1
        self.steps += 1
        return Taken(index, begins_anew)
