"""Closure on the monitor page: what the numerical substructure counted, not what a listener heard."""

import json

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.loop.closure_times import PARTS
from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.bag_description import start_metadata
from bmd_rths_msgs_py.growing_run import GrowingRun, Told
from bmd_rths_msgs_py.node_status import NodeStatus
from bmd_rths_nodes.monitor_page.view import _closure

COUNTS = [7, *[0] * (PARTS - 2), 2]


def run(versions=("rclpy",), **changes):
    story = start_metadata(Config().changed(**changes).as_mapping(), {"name": "a"}, dict.fromkeys(versions, "1"))
    return GrowingRun(story)


def told(step, **values):
    return Told(step, 100.0 + step, NodeStatus("/rths/numerical_substructure", NodeState.RUNNING, values=values))


def test_the_last_counts_are_shown():
    first = told(4, closure_counts=json.dumps([1] * PARTS), missed_deadlines="0")
    last = told(9, closure_counts=json.dumps(COUNTS), missed_deadlines="3")
    shown = _closure(run(), [first, last, told(10)])
    assert shown["counts"] == COUNTS
    assert (shown["late"], shown["deadline_ms"]) == (3, 5.0)
    assert shown["edges_ms"] == pytest.approx([0.125 * part for part in range(PARTS)])


def test_steps_that_were_all_late_are_shown_too():
    shown = _closure(run(), [told(9, closure_counts=json.dumps([0] * PARTS), missed_deadlines="3")])
    assert (sum(shown["counts"]), shown["late"]) == (0, 3)


@pytest.mark.parametrize("text", ["", "x", "{}", "[1.5]", "[-1]", '["a"]', "[true]"])
def test_what_cannot_be_understood_is_not_shown(text):
    assert _closure(run(), [told(9, closure_counts=text)]) == {"why": "nothing was told of it yet"}


def test_a_test_without_a_clock_has_none():
    entry = told(9, closure_counts=json.dumps(COUNTS))
    assert "lockstep" in _closure(run(run__lockstep=True), [entry])["why"]
    assert "in process" in _closure(run(versions=()), [entry])["why"]
