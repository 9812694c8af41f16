"""A node that says something five times, each time until it is acknowledged, or one that "hears"."""

import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration

from bmd_rths_nodes.ros import qos
from bmd_rths_nodes.ros.middleware import prepare_middleware

prepare_middleware()
rclpy.init()
if "hears" in sys.argv:
    reader = rclpy.create_node("reader")
    reader.create_subscription(DiagnosticArray, "/diagnostics", lambda message: None, qos.DIAGNOSTICS)
    rclpy.spin(reader)
publisher = rclpy.create_node("publisher").create_publisher(DiagnosticArray, "/diagnostics", qos.DIAGNOSTICS)
while not publisher.get_subscription_count():
    time.sleep(0.05)
for _ in range(5):
    publisher.publish(DiagnosticArray())
    print(publisher.wait_for_all_acked(Duration(seconds=2)))
