"""A shear estimator of your own, with ordinary messages: f = -sum(m_i a_i), without a filter."""

import math
import os
import socket
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from trajectory_msgs.msg import JointTrajectory

#: Reliable, so that the recorder gets every message; as deep as a loop at 200 Hz runs in five seconds.
RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)

#: How often the node tells its status [s]; at least once a second is required.
STATUS_PERIOD = 0.1

#: A status that is older is one of a recording that is played, or of a computer with another time [s].
LARGEST_AGE = 10.0


class MyShearEstimator(Node):
    """Answer every measurement with the interface shear of the same step."""

    def __init__(self):
        # The name and, below the namespace of the rig, the place where the others look for it.
        super().__init__("shear_estimator", namespace="rths")
        self.masses = list(self.declare_parameter("specimen.masses", [760.0, 800.0]).value)
        self.recorded = bool(self.declare_parameter("run.record", True).value)
        self.joints = ["table", *(f"floor_{i}" for i in range(1, len(self.masses) + 1)), "applied_command"]
        self.instance = f"process {os.getpid()} on {socket.gethostname()}"
        self.run, self.problem = "", ""
        self.reset()
        self.forces = self.create_publisher(WrenchStamped, "interface_force", RELIABLE)
        self.statuses = self.create_publisher(DiagnosticArray, "/diagnostics", RELIABLE)
        self.measurements = self.create_subscription(JointTrajectory, "measurement", self.on_measurement, RELIABLE)
        self.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, RELIABLE)
        self.create_timer(STATUS_PERIOD, self.tell)

    def reset(self):
        """Return to rest: a filter would forget its state here."""
        self.last_stamp = -1

    def on_measurement(self, message):
        """Check the message, and answer it at once: the table waits."""
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        if stamp == 0:
            self.reset()  # a new test begins with step 0
        if stamp <= self.last_stamp or not self.run:
            return  # a repeated step, or one of a test this node is not part of
        accelerations = message.points[0].accelerations if len(message.points) == 1 else []
        if list(message.joint_names) != self.joints or len(accelerations) != len(self.joints):
            self.problem = f"measurement of {list(message.joint_names)}; {self.joints} is required"
            return  # without an answer the step misses its deadline; a made-up one would move the table
        self.last_stamp = stamp
        floors = accelerations[1:-1]  # absolute, at the end of the step; what is not measured is NaN
        if not all(math.isfinite(a) for a in floors):
            return
        answer = WrenchStamped()
        answer.header.stamp = message.header.stamp  # the stamp is the step
        answer.header.frame_id = "interface"
        answer.wrench.force.x = -sum(m * a for m, a in zip(self.masses, floors, strict=True))
        self.forces.publish(answer)

    def on_diagnostics(self, message):
        """Take part in the test that the numerical substructure of this rig offers."""
        age = time.time() - (message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            leads = status.name == f"{self.get_namespace()}/numerical_substructure"
            offers = values.get("state") in ("waiting", "ready") and values.get("run", "") not in ("", self.run)
            if leads and offers and status.hardware_id == "bmd_rths" and abs(age) < LARGEST_AGE:
                self.run, self.problem = values["run"], ""
                self.reset()

    def obstacle(self):
        """Return what is missing before this node is ready; empty when nothing is."""
        if not self.run:
            return "waiting for numerical_substructure"
        if (count := self.count_publishers(self.measurements.topic_name)) != 1:
            return f"{self.measurements.topic_name} has {count} publishers, one is required"
        listeners = {info.node_name for info in self.get_subscriptions_info_by_topic(self.forces.topic_name)}
        missing = {"force_correction", *(["recorder"] if self.recorded else [])} - listeners
        if missing:
            return f"waiting for {', '.join(sorted(missing))}"
        matched = self.forces.get_subscription_count() == len(listeners)
        return "" if matched else f"waiting for the listeners of {self.forces.topic_name}"

    def tell(self):
        """Tell the state: `tripped` would end the test, and the table would be brought to rest."""
        obstacle = self.obstacle()
        state = "tripped" if self.problem else "waiting" if obstacle else "ready"
        level = DiagnosticStatus.ERROR if self.problem else DiagnosticStatus.OK
        values = {"state": state, "run": self.run, "instance": self.instance}
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        message.status = [
            DiagnosticStatus(
                level=level,
                name=self.get_fully_qualified_name(),
                message=self.problem or obstacle or state,
                hardware_id="bmd_rths",
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )
        ]
        self.statuses.publish(message)


def main():
    """Run the node until Ctrl-C. This executor keeps 5 ms; the usual one does not."""
    rclpy.init()
    node = MyShearEstimator()
    executor = EventsExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.05)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
