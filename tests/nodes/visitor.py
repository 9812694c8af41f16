"""An ordinary tool comes and goes: a reader of commands as `ros2 topic echo`, or "idle" as `ros2 node list`."""

import sys
import time

import rclpy
from geometry_msgs.msg import AccelStamped

ENOUGH, PATIENCE = 20, 12.0

heard = []
rclpy.init()
node = rclpy.create_node("visitor")
if "idle" in sys.argv:  # it reads nothing, so that whoever sends it something may have to wait
    time.sleep(1.5)
    sys.exit(0 if node.get_node_names() else "found nobody")
node.create_subscription(AccelStamped, "/rths/command", heard.append, 10)
give_up = time.monotonic() + PATIENCE
while len(heard) < ENOUGH and time.monotonic() < give_up:
    rclpy.spin_once(node, timeout_sec=0.1)
node.destroy_node()
rclpy.shutdown()
sys.exit(0 if len(heard) >= ENOUGH else f"heard {len(heard)} commands in {PATIENCE:g} s")
