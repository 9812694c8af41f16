"""What is slow only the first time is done before a node says ready, not between two commands."""

from __future__ import annotations

import linecache
import sys

from rclpy.impl.rcutils_logger import CallerId

#: Packages that log.
_PACKAGES = ("bmd_rths_nodes", "rclpy", "__main__")


def warm_up() -> None:
    """Do, without a message, what the first log call would do.

    To name the caller, rclpy has `inspect` look through every module of the process, and read the file of the caller:
    20 to 290 ms, which a table that was just stopped would have no command for.
    """
    CallerId()
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file is not None and name.partition(".")[0] in _PACKAGES:
            linecache.getlines(file)
