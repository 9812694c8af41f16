"""Faults of real processes by kind, each drawn at random by its seed."""

from __future__ import annotations

import math
import os
import resource
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bmd_rths_core.table.emulated.faults import SENSORS
from bmd_rths_msgs_py.topics import RECORDER, ROLES
from tests.domains import free_domain
from tests.faults.bench import SETTINGS, Bench
from tests.faults.outcome import Outcome
from tests.faults.process_trial import MISSES, Trial, run_trial
from tests.nodes.conftest import CONFIG, Child, processes_of_domain, wait_until

Random = np.random.Generator

#: Steps between which a fault begins.
FIRST, LAST = 60, 150

#: What is told when a node of the loop falls silent: by the numerical substructure, the table driver or the recorder.
_SILENCE = (
    MISSES,
    "stale_shear_time",
    "numerical substructure is gone",
    "nothing was heard",
)


def _step(random: Random) -> int:
    return int(random.integers(FIRST, LAST))


def _send(number: signal.Signals, process: str) -> Callable[[Bench], list[str]]:
    def happens(bench: Bench) -> list[str]:
        os.kill(bench.process_of(process), number)
        return []

    return happens


def _killed(process: str, composed: bool = False) -> Callable[[Random], Trial]:
    """Return a maker of trials in which a process is killed; a dead recorder cannot record that."""

    def draw(random: Random) -> Trial:
        terminal, bag = (f"{process} ended with status -9",), () if process == RECORDER else _SILENCE
        return Trial(f"{process} killed", composed, _step(random), terminal, bag, _send(signal.SIGKILL, process))

    return draw


def _stopped(process: str, composed: bool = False) -> Callable[[Random], Trial]:
    """Return a maker of trials in which a process gets no processor time any more."""

    def draw(random: Random) -> Trial:
        terminal, bag = _SILENCE, () if process == RECORDER else _SILENCE
        return Trial(f"{process} stopped", composed, _step(random), terminal, bag, _send(signal.SIGSTOP, process))

    return draw


def _command_line_killed(random: Random) -> Trial:
    def happens(bench: Bench) -> list[str]:
        bench.run.process.kill()
        wait_until(lambda: processes_of_domain(bench.domain) == {})
        return []

    return Trial("bmd-rths run killed", bool(random.integers(2)), _step(random), bag=("operator",), happens=happens)


def _disk_full(random: Random) -> Trial:
    """Forbid the recorder to make its file any larger, which is to it as a full disk: a write fails."""

    def happens(bench: Bench) -> list[str]:
        (file,) = bench.bags.glob("*/*.mcap")
        size = file.stat().st_size
        resource.prlimit(bench.process_of(RECORDER), resource.RLIMIT_FSIZE, (size, size))
        return []

    return Trial("disk full", bool(random.integers(2)), _step(random), ("cannot be written",), (), happens)


def _clock_jump(random: Random) -> Trial:
    """Let the wall clock of every process jump; nothing but the log times of the bag may depend on it."""
    jump = float(random.choice((-86400.0, -3600.0, -1.0, 1.0, 3600.0, 86400.0)))
    after = float(random.uniform(4.0, 8.0))

    def environment(folder: Path) -> dict[str, str]:
        (folder / "sitecustomize.py").write_text(
            "import time\n"
            "true, begin = time.time_ns, time.monotonic()\n"
            f"time.time_ns = lambda: true() + (time.monotonic() - begin > {after}) * {round(jump * 1e9)}\n"
            "time.time = lambda: 1e-9 * time.time_ns()\n"
        )
        return {"PYTHONPATH": f"{folder}:{os.environ.get('PYTHONPATH', '')}"}

    fault = f"wall clock jumps by {jump:g} s"
    return Trial(fault, bool(random.integers(2)), _step(random), environment=environment, finishes=True)


def _refused(child: Child, text: str) -> list[str]:
    result = child.wait(60.0)
    refused = result.status in (1, 2) and text in result.errors
    return [] if refused else [f"not refused with {text!r}: status {result.status}, {result.errors.strip()!r}"]


def _second_controller(random: Random) -> Trial:
    def happens(bench: Bench) -> list[str]:
        return _refused(bench.emulate(port=bench.port), "cannot be used")

    return Trial(
        "second controller on one port", bool(random.integers(2)), _step(random), happens=happens, finishes=True
    )


def _second_run(random: Random) -> Trial:
    def happens(bench: Bench) -> list[str]:
        return _refused(bench.bmd_rths("run", CONFIG, "--output", bench.folder / "second"), "another run is active")

    return Trial("second run on one domain", bool(random.integers(2)), _step(random), happens=happens, finishes=True)


def _second_host(random: Random) -> Trial:
    def happens(bench: Bench) -> list[str]:
        with free_domain() as number:
            domain = {"ROS_DOMAIN_ID": str(number)}
            child = bench.bmd_rths(*bench.run_arguments(bench.folder / "second"), "--composed", environment=domain)
            return _refused(child, "no answer from")

    return Trial(
        "second run with one controller", bool(random.integers(2)), _step(random), happens=happens, finishes=True
    )


def _foreign(topic: str, values: tuple[float, ...]) -> Callable[[Random], Trial]:
    """Return a maker of trials in which a foreign node publishes on a topic, for this step or a later one."""

    def draw(random: Random) -> Trial:
        value, ahead = float(random.choice(values)), int(random.choice((0, 0, 1, 1000)))

        def happens(bench: Bench) -> list[str]:
            time_step_ns = round(SETTINGS["run.time_step"] * 1e9)
            bench.start(Path(__file__).with_name("foreign_node.py"), topic, value, ahead, time_step_ns)
            return []

        # What it does is told as what it is, unless a limit is passed first.
        named = ("publishers", "safety.", *_SILENCE)
        fault = f"foreign node on {topic}: {value:g}, {ahead} steps ahead"
        return Trial(fault, bool(random.integers(2)), _step(random), named, named, happens)

    return draw


def _controller(random: Random) -> Trial:
    begins = _step(random)
    name, named = [
        ("loss", ()),
        ("delay", ()),
        ("bit_flips", ()),
        ("dead", ("stale_controller_time", *_SILENCE)),
        ("frozen", ("answers step",)),
        ("nan", ("non_finite_action",)),
        ("stuck", ("stuck_time",)),
        ("valve", ()),
        ("pressure", ()),
    ][int(random.integers(9))]
    value = {
        "loss": f"={random.uniform(1, 50):.1f}",
        "delay": f"={random.uniform(0, 20):.1f}",
        "bit_flips": f"={random.uniform(1, 50):.1f}",
        "nan": f"={random.choice(SENSORS)}",
        "stuck": f"={random.choice(SENSORS)}",
        "valve": f"={random.uniform(0, 50):.1f}",
        "pressure": f"={random.uniform(0, 90):.1f}",
    }.get(name, "")
    faults, composed = (f"{name}{value}@{begins}",), bool(random.integers(2))
    return Trial(f"controller: {name}{value}", composed, begins, named, named, faults=faults, can_rest=name != "frozen")


#: Makers of trials by kind.
KINDS: dict[str, Callable[[Random], Trial]] = {
    **{f"kill_{role}": _killed(role) for role in ROLES},
    **{f"stop_{role}": _stopped(role) for role in ROLES},
    "kill_composed_loop": _killed("composed_loop", composed=True),
    "stop_composed_loop": _stopped("composed_loop", composed=True),
    "kill_command_line": _command_line_killed,
    "disk_full": _disk_full,
    "clock_jump": _clock_jump,
    "second_controller": _second_controller,
    "second_run": _second_run,
    "second_host_process": _second_host,
    "foreign_command": _foreign("/rths/command", (math.nan, 1.0, -8.0, 1e6)),
    "foreign_shear": _foreign("/rths/corrected_force", (math.nan, 1e3, -1e5, 1e9)),
    "controller_process": _controller,
}


def outcome_of(kind: str, seed: int, folder: Path) -> Outcome:
    """Return what the fault of a kind and a seed comes to.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    seed : int
        Seed of everything random.
    folder : Path
        An empty folder.
    """
    return run_trial(kind, KINDS[kind](np.random.default_rng([seed, *kind.encode()])), folder)
