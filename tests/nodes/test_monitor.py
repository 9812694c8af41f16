"""`bmd-rths monitor`: what a run tells, without the run noticing."""

import itertools
import json
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from rosbags.highlevel import AnyReader

from bmd_rths_msgs_py.topics import ROLES
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.run.graph_state import take_snapshot
from tests.conftest import WITHOUT_LIMITS
from tests.nodes.conftest import CONFIG, recorded, wait_until

#: A busy machine must not end the run that is watched.
PATIENT = {"run__longest_miss_time": 20, "safety__stale_shear_time": 20, **WITHOUT_LIMITS}


def settings(**changes):
    return [word for name, value in changes.items() for word in ("--set", f"{name.replace('__', '.')}={value}")]


@pytest.mark.slow
def test_picture_of_a_run_has_its_nodes_test_table_and_bag_and_the_run_does_not_notice(bmd_rths, tmp_path, client):
    """A live page is there before the run begins, which is no second run on this domain; a second run is refused."""
    live = bmd_rths("monitor")
    wait_until(lambda: any(name.startswith("rths_monitor") for name in client.get_node_names()))
    endless = settings(ground_motion__free_vibration=600.0, run__preflight="skip", **PATIENT)
    run = bmd_rths("run", CONFIG, "--composed", *endless, "--output", tmp_path, "--json")
    wait_until(lambda: recorded(tmp_path, 200_000))

    picture = bmd_rths("monitor", "--json").wait()
    assert picture.status == 0, picture.errors
    told = json.loads(picture.output)
    assert {role: node["state"] for role, node in told["nodes"].items()} == {
        **dict.fromkeys(ROLES, "ready"),
        "numerical_substructure": "running",
    }
    assert 0 < told["test"]["step"] < told["test"]["steps"]
    assert told["test"]["clock"] == "real time"
    assert told["test"]["closure_ms"]["p50"] > 0.0
    assert (told["table"]["controller"], told["table"]["supervisor"], told["table"]["trips"]) == (
        "simulated",
        "normal",
        [],
    )
    for name, limit in (("displacement", 0.23), ("acceleration", 20.0), ("force", 500000.0)):
        motion = told["table"][name]
        assert abs(motion["now"]) <= motion["peak"]
        assert motion["peak"] > 0.0
        assert motion["limit"] == limit
    (bag,) = tmp_path.glob("el_centro*")
    assert told["recording"]["bag"] == str(bag)
    assert 200_000 < told["recording"]["bytes"] <= next(bag.glob("*.mcap")).stat().st_size

    page = bmd_rths("monitor", "--once").wait()
    assert page.status == 0
    for text in (*ROLES, "running", "missed deadlines", "stability indicator", "% of the limit 230", "bag: "):
        assert text in page.output

    second = bmd_rths("run", CONFIG, "--output", tmp_path / "second").wait()
    assert second.status == 2
    assert "another run is active on this ROS domain (bmd-rths on this computer)" in second.errors
    assert "set ROS_DOMAIN_ID to a free domain" in second.errors
    assert not (tmp_path / "second").exists()
    (file,) = bag.glob("*.mcap")
    size = file.stat().st_size
    wait_until(lambda: file.stat().st_size > size + 100_000)

    live.interrupt()
    ended = live.wait(30.0)
    assert (ended.status, ended.errors) == (0, "")
    assert "numerical_substructure" in ended.output
    run.interrupt()
    result = run.wait(60.0)
    told = json.loads(result.output)
    assert (told["outcome"], told["reason"]) == ("stopped", "table_driver: stopped by the operator"), result.errors


@pytest.mark.slow
def test_domain_without_a_run_is_one_clear_line(bmd_rths, domain):
    result = bmd_rths("monitor", "--json").wait()
    assert (result.status, result.output) == (1, "")
    assert result.errors == f"error: no run is on ROS domain {domain}\n"


@pytest.mark.slow
def test_bag_that_is_played_is_no_live_test(bmd_rths, client, domain, composed_run):
    with AnyReader([Path(composed_run.told["bag"])]) as reader:
        wanted = [connection for connection in reader.connections if connection.topic == "/diagnostics"]
        told = [data for _, _, data in reader.messages(wanted)]
    assert len(told) > 10
    player = client.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=100))
    monitor = bmd_rths("monitor", "--json")
    wait_until(lambda: player.get_subscription_count())
    statuses = itertools.cycle(told)
    wait_until(lambda: player.publish(next(statuses)) or monitor.process.poll() is not None)
    result = monitor.wait()
    assert (result.status, result.output) == (1, "")
    assert result.errors == f"error: no run is on ROS domain {domain}\n"


def test_node_that_has_told_nothing_is_named():
    snapshot = take_snapshot({}, {}, ["recorder"])
    assert snapshot == {
        "nodes": {"recorder": {"state": None, "message": "has told nothing yet", "there": True}},
        "test": None,
        "table": None,
        "recording": None,
    }


@pytest.mark.parametrize("text", ["", "nan", "much", "inf"])
def test_what_a_node_of_somebody_else_tells_is_taken_as_far_as_it_can_be_understood(text):
    told = NodeStatus("/rths/table_driver", "ready", values={"supervisor": "normal", "displacement": text})
    table = take_snapshot({"table_driver": told}, {"table_driver": 0.5}, ["table_driver"])["table"]
    assert table["displacement"] == {"now": None, "peak": None, "limit": None}
    assert table["trips"] == []


def test_trips_are_told_one_by_one():
    told = NodeStatus("/rths/table_driver", "tripped", values={"supervisor": "ramping", "trips": "one | two"})
    snapshot = take_snapshot({"table_driver": told}, {"table_driver": 0.5}, [])
    assert snapshot["table"]["trips"] == ["one", "two"]
    assert snapshot["nodes"]["table_driver"]["there"] is False
