"""The topics of a node: publishers, subscriptions, and whether both ends of each have found each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from bmd_rths_core.config import Config
from bmd_rths_msgs_py.topics import Topic
from bmd_rths_nodes.ros import qos
from bmd_rths_nodes.ros.intra_process import IntraProcess
from bmd_rths_nodes.ros.messages import codec_of, consumers_of, message_class


class Connections:
    """The connections of one node, through the middleware and, within its process, without it.

    Parameters
    ----------
    node : rclpy.node.Node
        The node.
    role : str
        Its role.
    intra_process : IntraProcess
        Nodes of the same process, which get their messages from there.
    """

    def __init__(self, node: Node, role: str, intra_process: IntraProcess) -> None:
        self._node, self._role, self._intra_process = node, role, intra_process
        self._publishers: list[tuple[Topic, Publisher]] = []
        self._subscriptions: list[tuple[Topic, Subscription]] = []
        self._inputs: list[tuple[str, Callable[[], int]]] = []
        self._producers: dict[str, str] = {}

    def publish_to(self, topic: Topic, config: Config, at_once: bool = False) -> Callable[[int, Any], None]:
        """Create the publisher of a topic and return what sends the value of a step, `at_once` or in its turn."""
        publisher = self._node.create_publisher(message_class(topic), topic.name, qos.PUBLISHER)
        self._publishers.append((topic, publisher))
        publish = publisher.publish if at_once else self._intra_process.sender(topic.name, publisher.publish)
        pack = codec_of(topic, config).pack
        stamp_of = config.run.stamps.of

        def send(step: int, value: Any) -> None:
            publish(pack(stamp_of(step), value))

        return send

    def listen(self, topic: Topic, on_message: Callable[[bytes], None], profile: QoSProfile) -> None:
        """Give every message of a topic of the loop to a function, through the middleware where that is needed."""
        resolved = self._node.resolve_topic_name(topic.name)  # the name by which publishers are counted
        self._producers[resolved] = topic.producer
        if self._intra_process.has(topic.producer):
            self._intra_process.subscribe(topic.name, self._role, on_message)
            self._inputs.append((resolved, lambda: self._node.count_publishers(resolved)))
            return
        subscription = self.listen_beside(topic, on_message, profile)
        self._inputs.append((subscription.topic_name, subscription.get_publisher_count))

    def listen_beside(self, topic: Topic, on_message: Callable[[bytes], None], profile: QoSProfile) -> Subscription:
        """Give the bytes of a topic to a function; who else publishes it does not matter."""
        subscription = self._node.create_subscription(message_class(topic), topic.name, on_message, profile, raw=True)
        self._subscriptions.append((topic, subscription))
        return subscription

    def matched(self, config: Config) -> bool:
        """Tell whether both ends of every connection that the loop needs have found each other."""
        for topic, publisher in self._publishers:
            readers = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
            needed = consumers_of(topic, config)
            needed -= self._intra_process.consumers(topic.name)
            if not needed <= {r.node_name for r in readers} or publisher.get_subscription_count() < len(readers):
                return False
        heard = (subscription.get_publisher_count() for topic, subscription in self._subscriptions if topic.required)
        return all(heard) and all(count_publishers() for _, count_publishers in self._inputs)

    def missing(self, config: Config) -> list[str]:
        """Return the roles that the loop needs and that are not there, in the order of the alphabet."""
        found = {self._producers[name] for name, count_publishers in self._inputs if not count_publishers()}
        for topic, publisher in self._publishers:
            readers = {r.node_name for r in self._node.get_subscriptions_info_by_topic(publisher.topic_name)}
            found |= consumers_of(topic, config) - self._intra_process.consumers(topic.name) - readers
        return sorted(found)

    def disturbance(self) -> str:
        """Return which input has more than one publisher, in words; empty when none has."""
        for topic_name, count_publishers in self._inputs:
            count = count_publishers()
            if count > 1:
                return f"{topic_name} has {count} publishers, one is allowed"
        return ""

    def destroy(self) -> None:
        """Destroy publishers and subscriptions; what was sent is published first."""
        self._intra_process.publish()
        self._intra_process.unsubscribe(self._role)
        for _, publisher in self._publishers:
            self._node.destroy_publisher(publisher)
        for _, subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._publishers.clear()
        self._subscriptions.clear()
        self._inputs.clear()
