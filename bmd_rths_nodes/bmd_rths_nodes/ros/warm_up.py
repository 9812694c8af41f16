"""What is slow only the first time is done before a node says ready, not between two commands."""

from __future__ import annotations

import inspect
import linecache
import sys
from types import ModuleType

from rclpy.impl.rcutils_logger import CallerId

#: Packages that log.
_PACKAGES = ("bmd_rths_nodes", "rclpy", "__main__")


def warm_up() -> None:
    """Do, without a message, what the first log call would do.

    To name the caller, rclpy has `inspect` find the module of its file, and read that file. It looks through every
    module of the process for it, and loads those that wait for their first use: 20 to 290 ms, which a table that was
    just stopped would have no command for. Here it is told the files of all modules instead.
    """
    for name, module in list(sys.modules.items()):
        if not isinstance(module, ModuleType):
            continue
        file = ModuleType.__getattribute__(module, "__dict__").get("__file__")  # loads none that waits for its use
        if not isinstance(file, str):
            continue
        inspect.modulesbyfile.setdefault(file, name)
        if name.partition(".")[0] in _PACKAGES:
            linecache.getlines(file)
    CallerId()
