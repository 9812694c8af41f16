"""Campaigns: pieces of work on processes, a cluster or the ROS graph, and their results."""
