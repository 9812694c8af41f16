"""Nodes of one process: who gets what, in which order, and what everybody else sees of it."""

import json

import pytest
from geometry_msgs.msg import AccelStamped
from lifecycle_msgs.msg import Transition
from rclpy.qos import QoSProfile

from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.topics import COMMAND, ROLES, SCALAR_TOPICS
from bmd_rths_nodes.ros.intra_process import IntraProcess
from tests.conftest import WITHOUT_LIMITS
from tests.nodes.conftest import CONFIG, change_state, wait_until


class Chain:
    """Two nodes: the second answers every message on a with one on b, which goes back to the first."""

    def __init__(self):
        self.done = []
        self.nodes = IntraProcess(["first", "second"])
        self.send_a = self.nodes.sender("a", lambda data: self.done.append(("publish a", data)))
        self.send_b = self.nodes.sender("b", lambda data: self.done.append(("publish b", data)))
        self.nodes.subscribe("a", "second", self.answer)
        self.nodes.subscribe("b", "first", lambda data: self.done.append(("first has", data)))

    def answer(self, data):
        self.done.append(("second has", data))
        self.send_b(data + data)


def test_answers_are_handed_over_before_anything_is_published_and_nothing_while_it_is_sent():
    chain = Chain()
    chain.send_a(b"1")
    chain.send_a(b"2")
    assert chain.done == []
    assert chain.nodes.deliver()
    handed = [("second has", b"1"), ("second has", b"2"), ("first has", b"11"), ("first has", b"22")]
    published = [("publish a", b"1"), ("publish a", b"2"), ("publish b", b"11"), ("publish b", b"22")]
    assert chain.done == handed + published
    assert not chain.nodes.deliver()


def test_node_that_has_unsubscribed_gets_nothing_and_everybody_else_still_does():
    chain = Chain()
    assert (chain.nodes.consumers("a"), chain.nodes.consumers("c")) == ({"second"}, set())
    chain.send_a(b"1")
    chain.nodes.unsubscribe("second")
    chain.nodes.deliver()
    assert chain.done == [("publish a", b"1")]
    assert chain.nodes.consumers("a") == set()


def test_message_of_a_node_that_raises_is_published_all_the_same():
    """The table driver makes itself safe then; what led to it must be in the bag."""
    chain = Chain()
    chain.nodes.subscribe("b", "first", lambda data: 1 / 0)
    chain.send_a(b"1")
    with pytest.raises(ZeroDivisionError):
        chain.nodes.deliver()
    assert chain.nodes.publish()
    assert chain.done == [("second has", b"1"), ("publish a", b"1"), ("publish b", b"11")]


def test_process_with_one_node_publishes_at_once():
    nodes = IntraProcess(["first"])
    published = []
    nodes.sender("a", published.append)(b"1")
    assert published == [b"1"]
    assert not nodes.deliver()


ENDLESS = {
    "ground_motion.free_vibration": 600.0,
    "run.preflight": "skip",
    "run.longest_miss_time": 20,
    "safety.stale_shear_time": 20,
    **{name.replace("__", "."): value for name, value in WITHOUT_LIMITS.items()},
}


@pytest.mark.slow
@pytest.mark.parametrize("clock", [(), ("--lockstep",)], ids=["real time", "lockstep"])
def test_composed_nodes_publish_for_everybody_take_from_nobody_and_do_not_go_on_beside_a_second_publisher(
    bmd_rths, tmp_path, client, clock
):
    heard = []
    client.create_subscription(AccelStamped, COMMAND.full_name, heard.append, QoSProfile(depth=1000))
    settings = [word for name, value in ENDLESS.items() for word in ("--set", f"{name}={value}")]
    run = bmd_rths("run", CONFIG, "--composed", *clock, *settings, "--output", tmp_path, "--json")
    wait_until(lambda: client.spin_some() or len(heard) > 100)
    for topic in SCALAR_TOPICS:
        readers = {reader.node_name for reader in client.get_subscriptions_info_by_topic(topic.full_name)}
        assert readers & set(ROLES) == {"recorder"}, topic.name
        assert client.count_publishers(topic.full_name) == 1
    client.create_publisher(AccelStamped, COMMAND.full_name, QoSProfile(depth=1))
    result = run.wait()
    assert result.status == 1
    told = json.loads(result.output)
    assert told["outcome"] == "failed"
    assert told["reason"] == "table_driver: /rths/command has 2 publishers, one is allowed"
    record = read_bag(told["bag"])
    client.spin_some()
    sent = {message.header.stamp.sec * 200 + message.header.stamp.nanosec // 5_000_000: message for message in heard}
    assert len(sent) > 100
    for step, message in sent.items():
        assert message.accel.linear.x == record.command[step]


@pytest.mark.slow
def test_composed_nodes_are_managed_one_by_one_and_find_each_other_again(client, start, tmp_path):
    parameters = tmp_path / "parameters.yaml"
    config = Config().changed(
        run__lockstep=True, ground_motion__duration=1.0, recorder__directory=str(tmp_path / "bags")
    )
    parameters.write_text(dump_config(config))
    for module in ("composed_loop", "recorder"):
        start("-m", f"bmd_rths_nodes.nodes.{module}", "--ros-args", "--params-file", parameters)
    expected = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()

    def recorded():
        return [f.parent for f in (tmp_path / "bags").glob("*/metadata.yaml") if "end of the ground" in f.read_text()]

    wait_until(lambda: len(recorded()) == 1)
    for transition in (
        Transition.TRANSITION_DEACTIVATE,
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_CONFIGURE,
        Transition.TRANSITION_ACTIVATE,
    ):
        for role in ROLES:
            assert change_state(client, transition, role)
    wait_until(lambda: len(recorded()) == 2)
    for bag in recorded():
        assert read_bag(bag).same_signals(expected)
