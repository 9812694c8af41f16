"""A test of real processes with a fault, and what has to hold after it."""

from __future__ import annotations

import json
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
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_msgs_py.bag_reader import read_bag
from tests.faults.bench import SETTINGS, Bench
from tests.faults.outcome import Outcome, wrong_motion
from tests.nodes.conftest import CONFIG, processes_of_domain

#: A test that a busy machine ends says nothing about the fault and is done again, so often.
ATTEMPTS = 3

#: Everything recorded longer before the fault has to be in the bag [s].
LARGEST_LOSS = 1.0

#: Longest time from the end of the run to rest [s]; longer than the ramp takes, because the machine is busy.
PATIENCE = 20.0

#: What a busy machine makes of a test, also where the emulator gets no turn when it is looked for; commands that come
#: late let the table drift, so that a test that should go on is ended at the displacement limit too.
MISSES = "deadlines in a row were missed"
_TOO_BUSY = (MISSES, "interlock (watchdog", "no answer from")

_STATISTICS = ("displacement", "velocity", "acceleration", "force")


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
        too_busy = MISSES not in trial.terminal and any(words in outcome.reason for words in named)
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
