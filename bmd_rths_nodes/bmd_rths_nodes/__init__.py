"""ROS 2 nodes and command line of real-time hybrid simulation on a shake table."""

import os

# Before numpy is imported, for every program of this package: the matrices are small, and on a busy machine the threads
# of the linear algebra wait for each other longer than they compute.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
