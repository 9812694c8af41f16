"""The six nodes, and the five of the loop in one process."""
