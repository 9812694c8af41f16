"""A node that does not belong here: it answers every desired acceleration with a wrong value on a topic of the loop."""

import sys

import rclpy
from geometry_msgs.msg import AccelStamped, WrenchStamped

rclpy.init()
node = rclpy.create_node("foreign_node")
topic, value, steps_ahead, time_step_ns = sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
publisher = node.create_publisher(AccelStamped if topic.endswith("command") else WrenchStamped, topic, 10)


def on_step(step: AccelStamped) -> None:
    message = publisher.msg_type()
    stamp = step.header.stamp.sec * 10**9 + step.header.stamp.nanosec + steps_ahead * time_step_ns
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    if topic.endswith("command"):
        message.accel.linear.x = value
    else:
        message.wrench.force.x = value
    publisher.publish(message)


node.create_subscription(AccelStamped, "/rths/desired_acceleration", on_step, 10)
rclpy.spin(node)
