"""What Linux does for a process that has to be in time: priority, locked memory, a processor of its own."""

from __future__ import annotations

import ctypes
import os

from bmd_rths_core.errors import InputError
from bmd_rths_core.run_config import RealTimeConfig
from bmd_rths_nodes.hardware.time_slice import shorten_time_slices

_MCL_CURRENT, _MCL_FUTURE = 1, 2


def enter_real_time(config: RealTimeConfig) -> list[str]:
    """Ask Linux for what the configuration wants, for every thread of this process and those to come.

    Parameters
    ----------
    config : RealTimeConfig
        What is wanted.

    Returns
    -------
    list of str
        What is in force, in words, and why a time slice is not; empty when nothing is wanted.

    Raises
    ------
    InputError
        This process may not have it.
    """
    in_force = []
    if config.lock_memory:
        if ctypes.CDLL(None, use_errno=True).mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
            reason = os.strerror(ctypes.get_errno())
            raise InputError(f"real_time.lock_memory: not permitted: {reason}; raise the limit `ulimit -l`")
        in_force.append("memory locked")
    if config.processor >= 0:
        try:
            os.sched_setaffinity(0, {config.processor})  # this thread; those of the middleware go where there is room
        except OSError as error:
            allowed = ", ".join(str(number) for number in sorted(os.sched_getaffinity(0)))
            raise InputError(
                f"real_time.processor: {config.processor} is not available; one of {allowed} is required"
            ) from error
        in_force.append(f"processor {config.processor}")
    if config.priority > 0:
        try:
            for thread in os.listdir("/proc/self/task"):
                os.sched_setscheduler(int(thread), os.SCHED_FIFO, os.sched_param(config.priority))
        except OSError as error:
            raise InputError(
                f"real_time.priority: {config.priority} is not permitted: {error.strerror}; raise the limit `ulimit -r`"
            ) from error
        in_force.append(f"SCHED_FIFO {config.priority}")
    elif words := shorten_time_slices(config.time_slice):
        in_force.append(words)
    return in_force
