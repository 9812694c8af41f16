"""What a run believes of statuses whose wall clock is not its own: recordings are old, and clocks are set back."""

import time

import pytest

from bmd_rths_core.loop.states import NodeState
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.run.monitor import RunMonitor

ROLE = "numerical_substructure"


def told_after(monitor, *statuses):
    """Tell statuses with their age [s], and return the state that is believed."""
    for age, state in statuses:
        seconds, rest = divmod(time.time() - age, 1.0)
        node = status.NodeStatus(f"{monitor.namespace}/{ROLE}", state)
        monitor._on_diagnostics(status.to_message(node, int(seconds), int(1e9 * rest)))
    return monitor.status[ROLE].state


def test_what_a_recording_repeats_is_not_believed():
    assert told_after(RunMonitor(), (1.0, NodeState.ENDED), (60.0, NodeState.RUNNING)) is NodeState.ENDED


@pytest.mark.parametrize("set_back", [5.0, 86_400.0])
def test_a_clock_that_is_set_back_does_not_hide_what_follows(set_back):
    """A run whose clock was set back by a day waited for a day."""
    assert told_after(RunMonitor(), (-set_back, NodeState.RUNNING), (0.0, NodeState.ENDED)) is NodeState.ENDED


def test_a_clock_that_is_set_forward_changes_nothing():
    assert told_after(RunMonitor(), (86_400.0, NodeState.RUNNING), (0.0, NodeState.ENDED)) is NodeState.ENDED
