"""What is measured of a computer: how late it wakes up, how fast its disk is, and how a test runs on it."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.record import TimingStatistics
from bmd_rths_msgs_py.topics import NAMESPACE, ROLES
from bmd_rths_nodes.doctor.finding import GOOD, NOTE, PROBLEM, WARNING, Finding

#: How long the timer is watched [s].
TIMER_TIME = 2.0

#: Rates that are judged besides that of the test [Hz].
RATES = (250, 400, 500, 1000, 2000)

#: Share of the time step that a wake-up may be late.
_LATE = 0.2

#: What a test records in a second [bytes], generously, and how much of the disk has to be free for one of an hour.
_RECORDED, _HOUR = 600_000, 3600

#: What is written to measure the disk: pieces as large as those of the recorder.
_PIECE, _PIECES = 16 * 1024, 256

#: Port of `bmd-rths emulate` and of the examples.
_TABLE_PORT = 50600


class Jitter(NamedTuple):
    """How late a process wakes up, at every time step [ms]."""

    p50: float
    p99: float
    largest: float


def timer(time_step: float, duration: float = TIMER_TIME) -> Jitter:
    """Sleep from step to step, and see how late each one begins."""
    late = []
    due = time.perf_counter() + time_step
    for _ in range(max(1, round(duration / time_step))):
        time.sleep(max(0.0, due - time.perf_counter()))
        late.append(1e3 * max(0.0, time.perf_counter() - due))
        due = max(due + time_step, time.perf_counter())
    return Jitter(percentile(late, 50), percentile(late, 99), max(late))


def percentile(values: Iterable[float], percent: float) -> float:
    """Return the smallest of some values that is not below so many percent of them."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, max(0, -(-len(ordered) * int(percent) // 100) - 1))]


def jitter_finding(jitter: Jitter, time_step: float) -> Finding:
    """Judge how late a process wakes up."""
    found = f"p50 {jitter.p50:.2f}, p99 {jitter.p99:.2f}, largest {jitter.largest:.2f} ms late"
    if jitter.p99 > _LATE * 1e3 * time_step:
        return Finding("timer", WARNING, found, "end other work; in a virtual machine, give it processors of its own")
    return Finding("timer", GOOD, found)


def disk(folder: Path) -> Finding:
    """Write a few megabytes where bags go, and see how fast that is and how much room is left."""
    name = f"disk, {folder}"
    there = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    try:
        free = shutil.disk_usage(there).free
        with tempfile.TemporaryFile(dir=there) as file:
            slowest, begin = 0.0, time.perf_counter()
            for _ in range(_PIECES):
                before = time.perf_counter()
                file.write(bytes(_PIECE))
                file.flush()
                slowest = max(slowest, time.perf_counter() - before)
            os.fsync(file.fileno())
            rate = _PIECE * _PIECES / (time.perf_counter() - begin)
    except OSError as error:
        return Finding(name, PROBLEM, f"cannot be written: {error.strerror}", "choose another --output")
    hours = free / _RECORDED / _HOUR
    found = f"{1e-6 * rate:.0f} MB/s, slowest write {1e3 * slowest:.1f} ms, free for {hours:.0f} h of tests"
    if hours < 1.0:
        return Finding(name, PROBLEM, found, "free some room")
    if rate < 10 * _RECORDED:
        return Finding(name, WARNING, found, "record on a local disk")
    return Finding(name, GOOD, found)


def table_port() -> Finding:
    """See whether the usual port of a table controller on this computer is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", _TABLE_PORT))
        except OSError:
            advice = f"an emulator may run; another one takes --listen udp://127.0.0.1:{_TABLE_PORT + 1}"
            return Finding(f"UDP port {_TABLE_PORT}", NOTE, "in use", advice)
    return Finding(f"UDP port {_TABLE_PORT}", GOOD, "free")


def others_finding(nodes: Sequence[str]) -> Finding:
    """Judge which nodes are on the domain."""
    if not nodes:
        return Finding("other nodes", GOOD, "none on this domain")
    listed = ", ".join(nodes[:6]) + (f" and {len(nodes) - 6} more" if len(nodes) > 6 else "")
    tests = sorted({name.rpartition("/")[0] for name in nodes if name.rpartition("/")[2] in ROLES})
    if tests:
        advice = f"a test is on this domain, in {', '.join(tests)}; set ROS_DOMAIN_ID to a free one"
        return Finding("other nodes", WARNING, listed, advice)
    return Finding("other nodes", NOTE, listed, f"they may stay; none of them may publish on a topic of {NAMESPACE}")


# ---- a real test


class LoopRun(NamedTuple):
    """A real test of composed nodes.

    Parameters
    ----------
    rate : float
        [Hz].
    steps : int
        Steps that were run.
    timing : TimingStatistics
        Deadlines that were missed, and how long the steps took to close.
    outcome : str
        How it ended, and why if it did not finish.
    """

    rate: float
    steps: int
    timing: TimingStatistics
    outcome: str


def run_loop(config: Config, duration: float) -> LoopRun:
    """Run a test of composed nodes with the simulated table, in real time, and record it.

    Parameters
    ----------
    config : Config
        The test; it gets the simulated table, the shipped record, and no limit on misses.
    duration : float
        Its length [s].

    Raises
    ------
    InputError
        It does not run.
    """
    from bmd_rths_msgs_py.bag_reader import read_bag

    config = config.changed(
        table__controller="simulated",
        ground_motion__record="el_centro_1940_ns",
        ground_motion__duration=duration,
        run__lockstep=False,
        run__preflight="skip",
        run__longest_miss_time=2.0,
        safety__stale_shear_time=2.0,
    )
    with tempfile.TemporaryDirectory(prefix="bmd_rths_doctor_") as folder:
        file = Path(folder) / "config.yaml"
        file.write_text(dump_config(config), encoding="utf-8")
        arguments = ("run", str(file), "--composed", "--json", "--output", f"{folder}/bags")
        done = subprocess.run(
            [sys.executable, "-m", "bmd_rths_nodes.cli.main", *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
        )
        told = _told(done.stdout)
        if "bag" not in told:
            raise InputError((done.stderr.strip().splitlines() or ["the test did not run"])[-1].removeprefix("error: "))
        record = read_bag(told["bag"])
    outcome = record.outcome if record.outcome == "finished" else f"{record.outcome}: {record.reason}"
    if record.timing is None:
        raise InputError(f"{outcome}; it told nothing of its deadlines")
    return LoopRun(1.0 / record.time_step, record.steps, record.timing, outcome)


def _told(text: str) -> dict[str, Any]:
    try:
        told = json.loads(text or "{}")
    except ValueError:
        return {}
    return told if isinstance(told, dict) else {}


def late_at(run: LoopRun, rate: float, jitter: Jitter) -> int:
    """Return how many of its steps would have been late at a higher rate: closure and wake-up longer than a step."""
    counts = run.timing.closure_counts
    longest = [1e3 / run.rate * (part + 1) / len(counts) for part in range(len(counts))]
    late = (count for count, closure in zip(counts, longest, strict=True) if closure + jitter.p99 > 1e3 / rate)
    return run.timing.missed_deadlines + sum(late)


def loop_finding(run: LoopRun) -> Finding:
    """Judge how a test ran."""
    missed, closure = run.timing.missed_deadlines, run.timing.closure_ms
    found = f"{missed} of {run.steps} deadlines missed at {run.rate:g} Hz"
    if any(run.timing.closure_counts):
        found += ", closure p50 {p50:.2f}, p99 {p99:.2f}, largest {max:.2f} ms".format(**closure)
    if run.outcome != "finished":
        return Finding("loop", PROBLEM, f"{found}; {run.outcome}", "end other work, or a longer run.time_step")
    if missed > 0.01 * run.steps:
        return Finding("loop", PROBLEM, found, "end other work, or a longer run.time_step")
    if missed:
        return Finding("loop", WARNING, found, "end other work; the last shear is held in a step that is late")
    return Finding("loop", GOOD, found)


def verdict(run: LoopRun, jitter: Jitter) -> str:
    """Say in plain words which rate this computer holds, with how many misses."""
    missed = run.timing.missed_deadlines
    told = f"{run.rate:g} Hz with composed nodes: {missed} of {run.steps} deadlines missed."
    if run.outcome != "finished" or missed > 0.01 * run.steps:
        return f"This computer does not hold {told} Look again with a longer run.time_step."
    late = {rate: late_at(run, rate, jitter) for rate in RATES if rate > run.rate}
    fastest = max((rate for rate, count in late.items() if count <= 0.01 * run.steps), default=None)
    further = "" if fastest is None else f" By the same closure times, {fastest:g} Hz would have {late[fastest]} late."
    return f"This computer holds {told}{further}"
