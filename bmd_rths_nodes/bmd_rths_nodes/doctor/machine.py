"""What files and environment tell of a computer: nothing is changed and nothing is measured."""

from __future__ import annotations

import importlib.util
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bmd_rths_nodes.doctor.finding import GOOD, NOTE, PROBLEM, WARNING, Finding

#: Versions of Python this project is tested with.
OLDEST, NEWEST = (3, 10), (3, 13)

#: Ports of DDS: domain d has those from here + 250 d on; those of one domain span as many.
_FIRST_PORT, _PORTS_OF_A_DOMAIN, _LAST_DOMAIN = 7400, 250, 232

#: What a message of 200 Hz takes in a receive buffer of Linux, with the kernel's own share [bytes], and how many come.
_BYTES_OF_A_MESSAGE, _MESSAGES_PER_SECOND = 768, 1600

#: Receive buffer that Linux has by default [bytes].
_USUAL_BUFFER = 212_992

#: Clocks of Linux that are read in less than a microsecond.
_FAST_CLOCKS = ("tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter")

#: Share of the processors that other programs may use.
_LARGEST_LOAD = 0.25


@dataclass(frozen=True)
class Machine:
    """A computer, as its files tell of it.

    Parameters
    ----------
    root : Path
        Where its files are; another folder in tests.
    environment : Mapping of str to str
        Environment of the process.
    """

    root: Path = Path("/")
    environment: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))

    def text(self, path: str) -> str | None:
        """Return the content of a small file; None where there is none."""
        try:
            return (self.root / path).read_text(errors="replace").strip()
        except OSError:
            return None

    def findings(self) -> list[Finding]:
        """Look at everything."""
        looks = (python, ros, middleware, domain, discovery, shared_memory, receive_buffer)
        others = (computer, processors, governor, kernel, clock, real_time)
        return [look(self) for look in (*looks, *others)]


def python(machine: Machine) -> Finding:
    """Look at the version of Python."""
    version = sys.version_info[:2]
    found = ".".join(map(str, sys.version_info[:3]))
    if OLDEST <= version <= NEWEST:
        return Finding("Python", GOOD, found)
    return Finding("Python", WARNING, found, "tests are run with 3.10 to 3.13; take one of these")


def ros(machine: Machine) -> Finding:
    """Look where ROS comes from."""
    found = importlib.util.find_spec("rclpy")
    if found is None or found.origin is None:
        advice = "pip install 'bmd_rths_nodes[ros]', or source the setup file of ROS 2 Jazzy; simulate works without"
        return Finding("ROS 2", NOTE, "not installed", advice)
    origin = Path(found.origin)
    distribution = machine.environment.get("ROS_DISTRO", "")
    kind = "from apt" if "/opt/ros/" in str(origin) else "wheels of this Python"
    if distribution not in ("", "jazzy"):
        return Finding("ROS 2", WARNING, f"{distribution}, {kind}", "tests are run with jazzy; source that one")
    return Finding("ROS 2", GOOD, f"jazzy, {kind}")


def middleware(machine: Machine) -> Finding:
    """Look at the middleware and its profile."""
    chosen = machine.environment.get("RMW_IMPLEMENTATION", "")
    if chosen and not chosen.startswith("rmw_fastrtps"):
        return Finding(
            "middleware", WARNING, chosen, "unset RMW_IMPLEMENTATION: times were measured with rmw_fastrtps_cpp"
        )
    profile = machine.environment.get("FASTRTPS_DEFAULT_PROFILES_FILE", "")
    if profile and not Path(profile).name.startswith("bmd_rths_"):
        advice = "unset FASTRTPS_DEFAULT_PROFILES_FILE, unless the profile has no shared memory"
        return Finding("middleware", WARNING, f"a profile of your own, {profile}", advice)
    return Finding("middleware", GOOD, "rmw_fastrtps_cpp, over UDP")


def domain(machine: Machine) -> Finding:
    """Look at the ROS domain and its ports."""
    text = machine.environment.get("ROS_DOMAIN_ID") or "0"
    if not text.isdecimal() or int(text) > _LAST_DOMAIN:
        return Finding("ROS domain", PROBLEM, text, f"set ROS_DOMAIN_ID to a number from 0 to {_LAST_DOMAIN}")
    number = int(text)
    first = _FIRST_PORT + _PORTS_OF_A_DOMAIN * number
    given = (machine.text("proc/sys/net/ipv4/ip_local_port_range") or "32768 60999").split()
    lowest, highest = int(given[0]), int(given[-1])
    if first <= highest and first + _PORTS_OF_A_DOMAIN > lowest:
        advice = (
            f"take one below {max(0, (lowest - _FIRST_PORT) // _PORTS_OF_A_DOMAIN)}: other programs may get its ports"
        )
        return Finding("ROS domain", WARNING, f"{number}, ports from {first}", advice)
    if number == 0:
        return Finding(
            "ROS domain", NOTE, "0, which everybody has", "give the test one of its own: export ROS_DOMAIN_ID=30"
        )
    return Finding("ROS domain", GOOD, f"{number}, ports from {first}")


def discovery(machine: Machine) -> Finding:
    """Look how far nodes look for each other."""
    scope = machine.environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    if scope == "OFF":
        return Finding("discovery range", PROBLEM, scope, "export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")
    if scope == "LOCALHOST" or machine.environment.get("FASTRTPS_DEFAULT_PROFILES_FILE"):
        return Finding("discovery range", GOOD, "this computer")
    advice = "where all nodes are here: export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST"
    return Finding("discovery range", NOTE, f"{scope}, the whole network", advice)


def shared_memory(machine: Machine) -> Finding:
    """Look for what killed ROS programs have left in shared memory."""
    files = [*(machine.root / "dev/shm").glob("fastrtps_*"), *(machine.root / "dev/shm").glob("fastdds_*")]
    if not files:
        return Finding("shared memory", GOOD, "nothing of Fast DDS is left over")
    advice = "when no ROS program runs: rm /dev/shm/fastrtps_* /dev/shm/fastdds_*; our nodes do not use it"
    return Finding("shared memory", NOTE, f"{len(files)} files of Fast DDS, in use or left over", advice)


def receive_buffer(machine: Machine) -> Finding:
    """Look how long a program may get no turn before messages are lost and sent again."""
    text = machine.text("proc/sys/net/core/rmem_default") or ""
    if not text.isdecimal():
        return Finding("receive buffer", NOTE, "not told by this system")
    held = int(text) / _BYTES_OF_A_MESSAGE / _MESSAGES_PER_SECOND
    found = f"{int(text) // 1024} KiB, about {held:.2f} s of messages"
    if int(text) < _USUAL_BUFFER:
        return Finding("receive buffer", WARNING, found, f"sudo sysctl -w net.core.rmem_default={_USUAL_BUFFER}")
    return Finding("receive buffer", GOOD, found)


def computer(machine: Machine) -> Finding:
    """Look whether the computer has its processors for itself."""
    flags = re.search(r"^flags\s*:(.*)$", machine.text("proc/cpuinfo") or "", re.MULTILINE)
    if flags is None:
        return Finding("computer", NOTE, "not told by this system")
    if "hypervisor" not in flags[1].split():
        return Finding("computer", GOOD, "its processors are its own")
    advice = "its host takes the processors away when it likes: drive a real table from a computer of its own"
    return Finding("computer", WARNING, "a virtual machine", advice)


def processors(machine: Machine) -> Finding:
    """Look at number and load of the processors."""
    count = os.cpu_count() or 1
    text = machine.text("proc/loadavg")
    if text is None:
        return Finding("processors", NOTE, f"{count}; the load is not told by this system")
    load = float(text.split()[0])
    found = f"{count}, {load:.1f} of them busy in the last minute"
    if count < 2:
        return Finding("processors", WARNING, found, "the loop and the recorder need two")
    if load > _LARGEST_LOAD * count:
        return Finding("processors", WARNING, found, "end other work: a busy computer misses many deadlines")
    return Finding("processors", GOOD, found)


def governor(machine: Machine) -> Finding:
    """Look whether processors slow down between two steps."""
    files = sorted((machine.root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
    found = sorted({file.read_text().strip() for file in files})
    if not found:
        return Finding("processor speed", NOTE, "not told by this system, as in most virtual machines")
    if found == ["performance"]:
        return Finding("processor speed", GOOD, "governor performance")
    advice = "sudo cpupower frequency-set -g performance: a processor that slows down between two steps wakes up late"
    return Finding("processor speed", WARNING, f"governor {', '.join(found)}", advice)


def kernel(machine: Machine) -> Finding:
    """Look whether the kernel is one for real time."""
    release = machine.text("proc/sys/kernel/osrelease") or "unknown"
    if machine.text("sys/kernel/realtime") == "1":
        return Finding("kernel", GOOD, f"{release}, PREEMPT_RT")
    return Finding("kernel", NOTE, release, "PREEMPT_RT shortens the longest stalls; 200 Hz is held without")


def clock(machine: Machine) -> Finding:
    """Look how the clock is read."""
    source = machine.text("sys/devices/system/clocksource/clocksource0/current_clocksource")
    if source is None:
        return Finding("clock", NOTE, "not told by this system")
    if source in _FAST_CLOCKS:
        return Finding("clock", GOOD, source)
    return Finding("clock", WARNING, f"{source}, slow to read", "look in the log of the kernel why tsc is not used")


def real_time(machine: Machine) -> Finding:
    """Look whether this user may ask for real-time priority."""
    try:
        import resource
    except ModuleNotFoundError:
        return Finding("real-time permission", NOTE, "not told by this system")
    highest = resource.getrlimit(resource.RLIMIT_RTPRIO)[1]
    allowed = os.geteuid() == 0 or highest != 0
    # Measured (docs/decisions/0004): it lowers the median, and risks a stall of 50 ms.
    return Finding("real-time permission", GOOD, "allowed" if allowed else "not allowed, and not needed")
