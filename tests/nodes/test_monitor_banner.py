"""What the page says of a test: its events and its banner."""

import math
from dataclasses import replace

import pytest

from bmd_rths_core.loop.states import NodeState
from bmd_rths_core.record import TimingStatistics
from bmd_rths_msgs_py.bag_follower import BagFollower
from bmd_rths_msgs_py.growing_run import GrowingRun, Told
from bmd_rths_msgs_py.node_status import NodeStatus
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_nodes.monitor_page import banner as banners
from bmd_rths_nodes.monitor_page.banner import banner, looking_back
from bmd_rths_nodes.monitor_page.events import EventLog
from bmd_rths_nodes.run.graph_state import take_snapshot


def told(role, state, message="", level=b"\x00", after=0, **values):
    return Told(after, 100.0, NodeStatus(f"/rths/{role}", NodeState(state), level, message or state, values))


def test_events_are_changes():
    log = EventLog()
    entries = [
        told("table_driver", "ready"),
        told("table_driver", "ready", after=3),
        told("numerical_substructure", "running", missed_deadlines="0"),
        told("numerical_substructure", "running", missed_deadlines="2", after=7),
        told("numerical_substructure", "running", missed_deadlines="2", after=8),
        told("numerical_substructure", "running", missed_deadlines="5", after=9),
        told("table_driver", "tripped", "safety.force_limit", b"\x02", 9, trips="force"),
        told("table_driver", "tripped", "safety.force_limit", b"\x02", 10, trips="force | displacement"),
    ]
    log.update(entries[:3])
    log.update(entries)
    assert [event.as_mapping() for event in log.events] == [
        {"step": 0, "level": "info", "text": "table driver ready"},
        {"step": 0, "level": "info", "text": "numerical substructure running"},
        {"step": 9, "level": "warning", "text": "5 deadlines missed"},
        {"step": 9, "level": "error", "text": "table driver tripped: safety.force_limit"},
        {"step": 9, "level": "error", "text": "supervisor: force"},
        {"step": 10, "level": "error", "text": "supervisor: displacement"},
    ]


@pytest.fixture
def run(simulated, tmp_path):
    follower = BagFollower(write_record(replace(simulated, outcome="stopped", reason="by hand"), tmp_path / "bag"))
    while follower.look():
        pass
    assert isinstance(follower.run, GrowingRun)
    return follower.run


def said(run, *entries, used=None, ago=0.1, signal_ago=0.1):
    statuses = {entry.status.role: entry.status for entry in entries}
    snapshot = take_snapshot(statuses, dict.fromkeys(statuses, 0.1), statuses)
    run.last_heard, run.last_signal = 1000.0 - ago, 1000.0 - signal_ago
    return tuple(banner(run, snapshot, used or {}, 1000.0))


RUNNING = told("numerical_substructure", "running", after=5)


def test_banner_says_how_a_test_has_ended(run):
    assert said(run, RUNNING) == ("STOPPED", "by hand", "care")


@pytest.mark.parametrize(("missed", "late_ticks", "colour"), [(6, 0, "good"), (7, 0, "care"), (0, 7, "care")])
def test_a_finished_test_that_did_not_keep_real_time_is_not_green(run, missed, late_ticks, colour):
    """One step in a hundred may be late, of the 600 of this run."""
    run.outcome, run.reason = "finished", "end of the ground motion"
    run.timing = TimingStatistics(missed, 1, (), late_ticks, {})
    word, sentence, found = said(run, RUNNING)
    assert (word, found) == ("FINISHED", colour)
    assert ("not in real time: 7 of" in sentence) == (colour == "care")


def test_banner_of_a_test_that_is_under_way(run):
    run.outcome = ""
    assert said(run, RUNNING) == ("RUNNING", "", "good")
    near = said(run, RUNNING, used={"displacement": 0.5, "actuator force": 0.85})
    assert near == ("NEAR A LIMIT", "actuator force at 85 % of its limit", "care")
    tripped = told("table_driver", "tripped", "safety.force_limit")
    assert said(run, RUNNING, tripped) == ("TRIPPED", "table driver: safety.force_limit", "alarm")
    ended = told("numerical_substructure", "ended")
    assert said(run, ended, told("table_driver", "ended", supervisor="ramping", table="moving"))[1] == (
        "the table is brought to rest"
    )
    waiting = told("numerical_substructure", "waiting", step="0", waiting_for="table_driver")
    assert said(run, waiting) == ("WAITING", "for table driver", "care")


def test_banner_never_shows_old_data_as_if_they_were_new(run):
    run.outcome = ""
    assert said(run, RUNNING, signal_ago=banners.STALE_SIGNALS + 0.5)[0] == "NO DATA"
    assert said(run, RUNNING, ago=banners.STALE + 0.5, signal_ago=10.0)[0] == "NO DATA"
    assert said(run, RUNNING, ago=math.inf, signal_ago=math.inf) == (
        "CUT",
        f"the recording has no end; it holds {run.shown_steps} steps",
        "alarm",
    )


def test_banner_never_says_running_of_the_past_and_shows_an_alarm_all_the_same():
    running, limit = banners.Banner("RUNNING", "", "good"), banners.Banner("LIMIT", "force", "alarm")
    back = looking_back(running, live=True, time=8.0)
    assert back == ("LOOKING BACK", "what is shown was at 8.00 s; now: running", "quiet")
    assert looking_back(limit, live=True, time=8.0) == ("LIMIT", "force; what is shown was at 8.00 s", "alarm")
    assert looking_back(limit, live=False, time=8.0).sentence == "what is shown was at 8.00 s; in the end: limit"
