"""How long the ordinary scheduler of Linux lets a thread run before others: the shorter, the sooner it runs when woken.

Linux 6.12 takes the length from any user (EEVDF); what wakes up with a short slice comes before what has a long one.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct

#: Numbers of sched_setattr(2) and sched_getattr(2) by machine.
_CALLS = {"x86_64": (314, 315), "aarch64": (274, 275)}

#: Structure sched_attr: size, policy, flags, nice, priority, runtime, deadline, period [ns].
_ATTRIBUTES = struct.Struct("=IIQiIQQQ")


def shorten_time_slices(seconds: float) -> str:
    """Ask for a time slice, for every thread of this process that the ordinary scheduler has, and those to come.

    Parameters
    ----------
    seconds : float
        The slice [s], 0.1 to 100 ms; 0 leaves it to the kernel.

    Returns
    -------
    str
        What is in force, or why it is not, in words; empty when nothing is wanted.
    """
    if seconds == 0.0:
        return ""
    calls = _CALLS.get(platform.machine())
    if calls is None or not os.path.isdir("/proc/self/task"):
        return f"time slice left to the kernel: not known how to ask for it on {platform.machine()}"
    for thread in map(int, os.listdir("/proc/self/task")):
        if os.sched_getscheduler(thread) == os.SCHED_OTHER and (problem := _shorten(thread, seconds, *calls)):
            return f"time slice left to the kernel: {problem}"
    return f"time slice {1e3 * seconds:g} ms"


def _shorten(thread: int, seconds: float, set_call: int, get_call: int) -> str:
    """Ask for the slice of a thread, and return why it does not have it."""
    libc, wanted = ctypes.CDLL(None, use_errno=True), round(1e9 * seconds)
    nice = os.getpriority(os.PRIO_PROCESS, thread)
    attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, os.SCHED_OTHER, 0, nice, 0, wanted, 0, 0)
    if libc.syscall(set_call, thread, attributes, 0) != 0:
        return os.strerror(ctypes.get_errno())
    got = ctypes.create_string_buffer(_ATTRIBUTES.size)
    if libc.syscall(get_call, thread, got, _ATTRIBUTES.size, 0) != 0:
        return os.strerror(ctypes.get_errno())
    return "" if _ATTRIBUTES.unpack(got.raw)[5] == wanted else "Linux 6.12 or later is required"
