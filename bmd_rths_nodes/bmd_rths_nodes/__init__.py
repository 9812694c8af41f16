"""ROS 2 nodes and command line of real-time hybrid simulation on a shake table."""
