"""Faults of real processes: `bmd-rths run` with the table of `bmd-rths emulate`, in real time on this machine."""

from __future__ import annotations

import json
import math
import os
import resource
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from bmd_rths_core.config import load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_core.table.emulated.faults import SENSORS
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.topics import RECORDER, ROLES
from tests.faults.outcome import Outcome, wrong_motion
from tests.nodes.conftest import CONFIG, Child, processes_of_domain, wait_until

Random = np.random.Generator

#: Long steps and patience, so that the fault decides and not a busy machine; a building too heavy to feel the shear.
SETTINGS = {
    "run.time_step": 0.02,
    "table.answer_timeout": 0.012,
    "numerical_substructure.masses": [8.0e6],
    "ground_motion.time_scale": 1.0,
    "ground_motion.duration": 20.0,
    "ground_motion.peak_acceleration": 0.3,
    "safety.ramp_acceleration": 0.5,
    "safety.velocity_limit": 0.4,  # so that the longest way to rest, for which a silent recorder is waited, is short
    "run.longest_miss_time": 2.0,
    "run.preflight": "skip",
    "run.settling_time": 0.0,  # nobody else is on the domain
    "safety.stale_shear_time": 2.0,
    "safety.stale_controller_time": 2.0,
}
#: Silence of the host after which the controller brings the table to rest [s]. It holds the last command until then;
#: the small accelerations above leave the table within its stroke, which 5 m/s² would not.
WATCHDOG = 0.5

#: A test that a busy machine ends says nothing about the fault and is done again, so often.
ATTEMPTS = 3

#: Steps between which a fault begins.
FIRST, LAST = 60, 150

#: Everything recorded longer before the fault has to be in the bag [s].
LARGEST_LOSS = 1.0

#: Longest time from the end of the run to rest [s]; longer than the ramp takes, because the machine is busy.
PATIENCE = 20.0

#: What a busy machine makes of a test, also where the emulator gets no turn when it is looked for; commands that come
#: late let the table drift, so that a test that should go on is ended at the displacement limit too.
_MISSES = "deadlines in a row were missed"
_TOO_BUSY = (_MISSES, "interlock (watchdog", "no answer from")

_STATISTICS = ("displacement", "velocity", "acceleration", "force")


def _arguments(settings: dict[str, Any]) -> list[str]:
    return [word for name, value in settings.items() for word in ("--set", f"{name}={json.dumps(value)}")]


class Bench:
    """An emulator and a run with it, in a folder and on the ROS domain of the environment."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.domain = int(os.environ["ROS_DOMAIN_ID"])
        self.children: list[Child] = []

    def start(self, *arguments: object, environment: dict[str, str] | None = None) -> Child:
        """Start Python with arguments."""
        folder = self.folder / f"child_{len(self.children)}"
        folder.mkdir()
        before = dict(os.environ)
        os.environ.update(environment or {})
        try:
            self.children.append(Child(folder, [str(argument) for argument in arguments]))
        finally:
            os.environ.clear()
            os.environ.update(before)
        return self.children[-1]

    def bmd_rths(self, *arguments: object, **options: Any) -> Child:
        """Start the command line."""
        return self.start("-m", "bmd_rths_nodes.cli.main", *arguments, **options)

    def emulate(self, faults: tuple[str, ...] = (), port: int = 0) -> Child:
        """Start an emulator."""
        options = [word for fault in faults for word in ("--fault", fault)]
        watchdog = ("--set", f"virtual_controller.watchdog={WATCHDOG}")
        return self.bmd_rths("emulate", CONFIG, "--listen", f"udp://127.0.0.1:{port}", "--json", *watchdog, *options)

    def begin(self, composed: bool, faults: tuple[str, ...] = (), environment: dict[str, str] | None = None) -> None:
        """Start emulator and run."""
        self.emulator = self.emulate(faults)
        ready = json.loads(wait_until(lambda: self.emulator.output.read_text().partition("\n")[0]))
        self.port, self._control_port = ready["port"], ready["control_port"]
        self.bags = self.folder / "bags"
        how = ("--composed",) if composed else ()
        self.run = self.bmd_rths(*self.run_arguments(self.bags), *how, environment=environment)

    def run_arguments(self, output: Path) -> list[object]:
        """Return the arguments of a run with the emulator."""
        settings = _arguments(SETTINGS)
        table = ("--table", f"udp://127.0.0.1:{self.port}")
        return ["run", CONFIG, "--scheme", "uc", *table, *settings, "--output", output, "--json"]

    def tell(self, line: str) -> dict[str, Any]:
        """Say something on the control port of the emulator and return what it says."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
            control.settimeout(20.0)
            control.sendto(line.encode(), ("127.0.0.1", self._control_port))
            return json.loads(control.recv(4096))

    def until_step(self, step: int) -> None:
        """Wait until the controller has got about as many commands, or the run has ended."""
        wait_until(lambda: self.run.process.poll() is not None or self.tell("status").get("received", 0) > step)

    def process_of(self, name: str) -> int:
        """Return the process id of a node."""
        found = [pid for pid, command in processes_of_domain(self.domain).items() if f".{name}" in command]
        assert len(found) == 1, f"{name}: {found}"
        return found[0]

    def close(self) -> None:
        """End every process that is left."""
        for child in self.children:
            if child.process.poll() is None:
                child.process.send_signal(signal.SIGCONT)
                child.process.send_signal(signal.SIGINT)
        for child in self.children:
            try:
                child.process.wait(10.0)
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()


@dataclass(frozen=True)
class Trial:
    """A run with a fault.

    Parameters
    ----------
    fault : str
        The fault, in words.
    composed : bool
        The five nodes of the loop share one process.
    begins : int
        Step of the fault.
    terminal, bag : tuple of str
        One of each has to be told there; empty when the test may go on, or where nothing can be told any more.
    happens : callable, optional
        Makes the fault; returns what should have been different.
    faults : tuple of str
        Of network, controller and table, as `bmd-rths emulate` takes them.
    environment : callable, optional
        Environment of the run, made in a folder.
    can_rest : bool
        False when nobody can bring the table to rest any more.
    finishes : bool
        The test must go on to its end, undisturbed.
    """

    fault: str
    composed: bool
    begins: int
    terminal: tuple[str, ...] = ()
    bag: tuple[str, ...] = ()
    happens: Callable[[Bench], list[str]] | None = None
    faults: tuple[str, ...] = ()
    environment: Callable[[Path], dict[str, str]] | None = None
    can_rest: bool = True
    finishes: bool = False


def run_trial(kind: str, trial: Trial, folder: Path) -> Outcome:
    """Run a test with a fault and look at what has to hold.

    Parameters
    ----------
    kind : str
        Kind of the fault.
    trial : Trial
        The test.
    folder : Path
        An empty folder.
    """
    for attempt in range(ATTEMPTS):
        attempt_folder = folder / str(attempt)
        attempt_folder.mkdir()
        outcome = _attempt(kind, trial, attempt_folder)
        named = _TOO_BUSY + (("safety.displacement_limit",) if trial.finishes else ())
        too_busy = _MISSES not in trial.terminal and any(words in outcome.reason for words in named)
        if not (outcome.wrong and too_busy):
            break
    return outcome


def _attempt(kind: str, trial: Trial, folder: Path) -> Outcome:
    bench = Bench(folder)
    wrong: list[str] = []
    try:
        bench.begin(trial.composed, trial.faults, trial.environment(folder) if trial.environment else None)
        bench.until_step(trial.begins)
        if bench.run.process.poll() is not None and not trial.faults:
            wrong.append("the test ended before the fault")
        elif trial.happens is not None:
            wrong += trial.happens(bench)
        result = bench.run.wait(120.0)
        since = time.monotonic()
        state = bench.tell("status")
        while not state["at_rest"] and time.monotonic() < since + PATIENCE:
            state = bench.tell("status")
            time.sleep(0.02)
        return _judged(kind, trial, bench, result, state, wrong)
    finally:
        bench.close()


def _judged(
    kind: str, trial: Trial, bench: Bench, result: SimpleNamespace, state: dict[str, Any], wrong: list[str]
) -> Outcome:
    config = load_config(CONFIG).changed(run__time_step=SETTINGS["run.time_step"], table__answer_timeout=0.012)
    motion = TrueMotion(*(state[name] for name in _STATISTICS))
    peaks = TrueMotion(*(state[f"peak_{name}"] for name in _STATISTICS))
    in_motion = wrong_motion(config, motion, peaks) + ([] if state["at_rest"] else ["the table is still moved"])
    wrong = wrong + [text for text in in_motion if trial.can_rest or not ("rest" in text or "still" in text)]
    left = processes_of_domain(bench.domain)
    if left:
        wrong.append(f"processes are left: {sorted(left.values())}")
    if "Traceback" in result.errors:
        wrong.append("a traceback on the terminal")
    record, told = _bag(bench), json.loads(result.output) if result.output else {}
    ended = record.outcome if record is not None else "no bag"
    if record is None:
        wrong.append("the bag cannot be read")
    else:
        wrong += _lost(trial, record)
    terminal = f"{told.get('reason', '')} {result.errors}"
    in_bag = f"{record.reason} {_trips(bench)}" if record is not None and trial.bag else ""
    for names, text, where in ((trial.terminal, terminal, "on the terminal"), (trial.bag, in_bag, "in the bag")):
        if names and not any(name in text for name in names):
            wrong.append(f"none of {names} is told {where}: {text.strip()!r}")
    if trial.finishes and (ended, result.status) != ("finished", 0):
        wrong.append(f"the test did not go on: {ended}, {terminal.strip()!r}")
    if trial.terminal and result.status == 0:
        wrong.append("the run ended with status 0")
    return Outcome(kind, trial.fault, ended, told.get("reason") or result.errors.strip(), tuple(wrong), peaks)


def _bag(bench: Bench) -> RunRecord | None:
    bags = sorted(bench.bags.glob("*/*.mcap")) if bench.bags.is_dir() else []
    try:
        return read_bag(bags[0].parent)
    except (IndexError, InputError, OSError):
        return None


def _lost(trial: Trial, record: RunRecord) -> list[str]:
    """Return what was lost of the time up to one second before the fault."""
    kept = max(0, trial.begins - round(LARGEST_LOSS / SETTINGS["run.time_step"]))
    # Every step has one; a command may be missing because its message did not reach the command shaper in time.
    missing = kept - int(np.isfinite(record.desired_acceleration[:kept]).sum())
    return [f"{missing} steps from more than 1 s before the fault are not in the bag"] if missing else []


def _trips(bench: Bench) -> str:
    """Return what every node has told in the bag."""
    told = []
    with AnyReader([next(bench.bags.iterdir())]) as reader:
        connections = [c for c in reader.connections if c.topic == "/diagnostics"]
        for connection, _, raw in reader.messages(connections):
            for status in reader.deserialize(raw, connection.msgtype).status:
                values = {pair.key: pair.value for pair in status.values}
                told.append(f"{status.name} {status.message} {values.get('trips', '')}")
    return " ".join(dict.fromkeys(told))


# ---- kinds

#: What is told when a node of the loop falls silent: by the numerical substructure, the table driver or the recorder.
_SILENCE = (
    _MISSES,
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
        domain = {"ROS_DOMAIN_ID": str(101 - bench.domain % 2)}
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
