"""One test on the ROS graph: its processes, what they tell, and its end."""
