"""What is slow only the first time is done before a node says ready, not between two commands."""

from __future__ import annotations

import linecache
import sys

from rclpy.impl.rcutils_logger import CallerId


def warm_up() -> None:
    """Do once what the first log call would do: rclpy looks through every module, and reads the file of the caller."""
    CallerId()  # the search, without a message
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and name.partition(".")[0] in ("__main__", *_PACKAGES):
            linecache.getlines(file)


_PACKAGES = ("bmd_rths_nodes", "rclpy")
