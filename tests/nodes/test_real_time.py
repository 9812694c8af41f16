"""What Linux does for the processes of the loop: it is in force in every thread, or refused in one line."""

import os
import resource
import sys

import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.run_config import RealTimeConfig
from bmd_rths_nodes.hardware.time_slice import shorten_time_slices
from bmd_rths_nodes.ros.real_time import enter_real_time
from tests.nodes.conftest import CONFIG, processes_of_domain, wait_until

#: Begin a thread that tells what it has when it is let go; `tell` stands before this.
EARLY = """
going, ended = threading.Event(), threading.Event()
def before():
    going.set()
    ended.wait()
    tell()

early = threading.Thread(target=before)
early.start()
going.wait()
"""

#: Let it go, and tell what a later thread has, and the first one.
LATE = """
ended.set()
early.join()
late = threading.Thread(target=tell)
late.start()
late.join()
tell()
"""

#: Enter real time beside a thread that is there and before one that comes, and tell what each has.
ASK = """
import os, sys, threading
from bmd_rths_core.run_config import RealTimeConfig
from bmd_rths_nodes.ros.real_time import enter_real_time
from bmd_rths_core.errors import InputError

def tell():
    print(os.sched_getscheduler(0) == os.SCHED_FIFO, os.sched_getparam(0).sched_priority)
"""

ENTER = """
try:
    print(enter_real_time(RealTimeConfig(priority=7, processor=min(os.sched_getaffinity(0)), lock_memory=True)))
    print(len(os.sched_getaffinity(0)))
except InputError as error:
    ended.set()
    sys.exit(str(error))
"""


def test_it_is_in_force_in_every_thread_or_refused(start):
    result = start("-c", ASK + EARLY + ENTER + LATE).wait()
    if result.status == 0:
        processor = min(os.sched_getaffinity(0))
        told = [f"['memory locked', 'processor {processor}', 'SCHED_FIFO 7']", "1", *["True 7"] * 3]
        assert result.output.splitlines() == told
        with open("/proc/self/status", encoding="utf-8") as own:
            assert "VmLck:\t       0 kB" in own.read()  # the process of the test is as it was
    else:
        assert "is not permitted" in result.errors or "not permitted: " in result.errors
        limits = (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK)
        assert any(resource.getrlimit(limit)[0] != resource.RLIM_INFINITY for limit in limits)


def test_processor_that_is_not_there_is_refused():
    with pytest.raises(InputError, match=r"^real_time.processor: 1023 is not available; one of [\d, ]+ is required$"):
        enter_real_time(RealTimeConfig(processor=1023))


def test_nothing_wanted_changes_nothing():
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    assert enter_real_time(RealTimeConfig(time_slice=0.0)) == []
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before


#: Take a time slice beside a thread that is there and before one that comes, and tell what each has [ns].
ASK_FOR_A_SLICE = """
import ctypes, os, sys, threading
from bmd_rths_nodes.hardware.time_slice import _ATTRIBUTES, _CALLS, shorten_time_slices

def tell():
    got = ctypes.create_string_buffer(_ATTRIBUTES.size)
    ctypes.CDLL(None).syscall(_CALLS[os.uname().machine][1], 0, got, _ATTRIBUTES.size, 0)
    print(_ATTRIBUTES.unpack(got.raw)[3:6:2])

os.nice(3)"""

SHORTEN = """
print(shorten_time_slices(float(sys.argv[1])))
"""


def test_time_slice_is_that_of_every_thread_and_leaves_its_niceness(start):
    result = start("-c", ASK_FOR_A_SLICE + EARLY + SHORTEN + LATE, "0.0002").wait()
    assert result.status == 0, result.errors
    words, *threads = result.output.splitlines()
    if tuple(map(int, os.uname().release.split("-")[0].split(".")[:2])) >= (6, 12):
        assert words == "time slice 0.2 ms"
        assert threads == [f"({os.nice(0) + 3}, 200000)"] * 3  # the tests may have been started with a niceness
    else:
        assert words.startswith("time slice left to the kernel: ")


def test_a_machine_whose_calls_are_not_known_is_told(monkeypatch):
    monkeypatch.setattr("platform.machine", lambda: "riscv64")
    assert shorten_time_slices(1e-4) == "time slice left to the kernel: not known how to ask for it on riscv64"


def test_a_time_slice_that_linux_has_not_is_refused():
    with pytest.raises(InputError, match=r"^real_time.time_slice: 5e-05 s; 0, or 0.0001 s or more, is required$"):
        RealTimeConfig(time_slice=5e-5)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="needs the right to real-time priority")
def test_loop_of_a_run_is_in_real_time_and_its_recorder_is_not(bmd_rths, domain, tmp_path):
    settings = ("--set", "real_time.priority=7", "--set", "run.preflight=skip", "--set", "ground_motion.duration=4.0")
    child = bmd_rths("run", CONFIG, "--composed", *settings, "--output", tmp_path)
    names = {"composed_loop": os.SCHED_FIFO, "recorder": os.SCHED_OTHER}

    def schedulers():
        found = {}
        for pid, command in processes_of_domain(domain).items():
            for name in names:
                if f"nodes.{name}" in command:
                    found[name] = os.sched_getscheduler(pid)
        return found == names

    wait_until(schedulers)
    child.wait()
