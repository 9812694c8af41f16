"""By the clock: when commands arrive at a controller on UDP, and where they lead its table, for every ending of a test.

The product runs as a person starts it, in real time, against a controller in this process whose packets are stamped by
the kernel (tests/clock/arrivals.py). Each command counts for the time it was really held. Run it with

    python benchmarks/by_the_clock.py                 # the table: every mode, answer and ending
    python benchmarks/by_the_clock.py --aborts 200    # random aborts by seed, in real time

A test that ends by itself before its abort comes is counted apart, as "ended before"; its table has to be at rest too.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.host_witness import HostWitness
from bmd_rths_core.config import Config
from bmd_rths_core.table.wire import Kind
from bmd_rths_msgs_py.bag_reader import read_bag
from tests.clock.arrivals import Arrival, ArrivalController, held, periods

CONFIG = Path(__file__).parents[1] / "config" / "simplified_bmd.yaml"
MODES = {"composed": ("--composed",), "five": ()}
PROCESSES = {"composed": ("composed_loop",), "five": ("numerical_substructure", "table_driver", "shear_estimator")}
ENDINGS = ("end", "driver", "indicator", "ctrl-c", "stall")

#: What a test comes to that its ending has ended; one may survive a stall.
OUTCOMES = {"end": "finished", "driver": "limit", "indicator": "limit", "ctrl-c": "stopped"}

#: Longest time from Ctrl-C to the last command of the test [s]; otherwise it was not Ctrl-C that ended it.
HEARD_WITHIN = 1.0

#: The table is at rest when it is slower and nearer than this [m/s, m].
AT_REST = 1e-3


class Run(NamedTuple):
    """What arrived at the controller in one test."""

    outcome: str
    off_percent: float  # commands whose period is more than 1 ms off
    quiet_off_percent: float  # the same of those during which the host was not slow
    quiet_percent: float  # how many those are
    first_ms: float  # period before the first command on the way to rest
    velocity: float
    displacement: float
    largest_velocity: float
    largest_displacement: float
    missed: int
    steps: int
    told: str = ""  # why the test ended, and what else was said
    emergency: bool = False  # the controller was asked for the emergency stop: the rest of the way is its own
    ended_before: bool = False  # the test ended by itself, before its ending came
    ignored: bool = False  # its ending came, and it went on

    @property
    def wrong(self) -> list[str]:
        """What does not hold, but for a stall, which may lead anywhere."""
        limits, found = Config().safety, []
        if self.ignored:
            found.append("went on")
        if not self.emergency and max(abs(self.velocity), abs(self.displacement)) > AT_REST:
            found.append("not at rest")
        if self.largest_displacement > limits.displacement_limit + 0.005 * self.largest_velocity:
            found.append("beyond the displacement limit")
        if self.largest_velocity > limits.velocity_limit + 0.005 * limits.acceleration_limit:
            found.append("beyond the velocity limit")
        return found


def run(
    mode: str, answer_after: float, ending: str, rng: random.Random, given: tuple[str, ...] = (), duration: float = 6.0
) -> Run:
    """Run a test and return what arrived."""
    own = {"driver": ["safety.acceleration_limit=1.2"]}.get(ending, [])
    floor_gain = 20.0 if ending == "indicator" else 1.0  # a loop with so heavy a specimen is unstable
    pairs = [f"ground_motion.duration={duration}", "run.settling_time=0.0", "run.preflight=skip", *own, *given]
    settings = [word for pair in pairs for word in ("--set", pair)]
    with (
        HostWitness() as witness,
        tempfile.TemporaryDirectory(prefix="clock_") as folder,
        ArrivalController(answer_after, floor_gain=floor_gain) as controller,
    ):
        options = ("--table", controller.address, "--scheme", "uc", "--json")
        command = ["-m", "bmd_rths_nodes.cli.main", "run", str(CONFIG), *options, *settings, *MODES[mode]]
        child = subprocess.Popen(
            [sys.executable, *command, "--output", folder], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        aborted = math.inf
        if ending in ("ctrl-c", "stall"):
            aborted = abort(child, controller, ending, mode, rng, duration)
        output, errors = child.communicate(timeout=120.0)
        told = told_by(output, errors, ending, Path(folder))
        commands = controller.commands
        emergency = any(arrival.kind is Kind.EMERGENCY_STOP for arrival in controller.arrivals)
    words = " | ".join([told["reason"], *errors.splitlines()])
    last = max(arrival.time for arrival in commands if arrival.step < told["steps"])
    before, ignored = came_to(ending, told["outcome"], aborted, last)
    result = judged(told, commands, witness)
    return result._replace(emergency=emergency, told=words, ended_before=before, ignored=ignored)


def told_by(output: str, errors: str, ending: str, folder: Path) -> dict[str, Any]:
    """Return what `run` told of a test; its bag tells it when Ctrl-C came after the test and ended the analysis."""
    if output:
        told: dict[str, Any] = json.loads(output)
        return told
    if ending != "ctrl-c" or errors.splitlines()[-1:] != ["stopped"]:
        raise click.ClickException(f"run told nothing: {errors}")
    (bag,) = (path for path in folder.iterdir() if path.is_dir())
    record = read_bag(bag)
    missed = 0 if record.timing is None else record.timing.missed_deadlines
    return {"outcome": record.outcome, "reason": record.reason, "steps": record.steps, "missed_deadlines": missed}


def came_to(ending: str, outcome: str, aborted: float, last: float) -> tuple[bool, bool]:
    """Tell whether a test ended by itself before its ending came, and whether it went on after that.

    `aborted` is when Ctrl-C or a stall came, infinite when nothing was left to hold up, and `last` when the last
    command of the test arrived [s, wall clock].
    """
    if ending == "stall":
        return aborted > last, False
    if outcome == OUTCOMES[ending]:
        return False, False
    ignored = last > aborted + HEARD_WITHIN if ending == "ctrl-c" else outcome == "finished"
    return not ignored, ignored


def abort(
    child: Any, controller: ArrivalController, ending: str, mode: str, rng: random.Random, duration: float
) -> float:
    """Interrupt the test, or hold one of its processes up, at a random time; return it [s, wall clock]."""
    begin = time.monotonic() + 60.0
    while not controller.commands and child.poll() is None and time.monotonic() < begin:
        time.sleep(0.005)
    time.sleep(rng.uniform(0.1, 0.8 * duration))
    aborted = time.time()
    if ending == "ctrl-c":
        child.send_signal(signal.SIGINT)
        return aborted
    found = running(child.pid, f"nodes.{rng.choice(PROCESSES[mode])}")
    signalled(found, signal.SIGSTOP)
    time.sleep(rng.uniform(0.05, 0.5))
    signalled(found, signal.SIGCONT)
    return aborted if found else math.inf


def signalled(pids: list[int], number: signal.Signals) -> None:
    """Send a signal to processes, of which some may have ended."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def running(parent: int, name: str) -> list[int]:
    """Return the children of a process whose command has a name; none when the process has ended."""
    found = []
    with contextlib.suppress(FileNotFoundError):
        for pid in Path(f"/proc/{parent}/task/{parent}/children").read_text().split():
            with contextlib.suppress(FileNotFoundError):
                if name in Path(f"/proc/{pid}/cmdline").read_text():
                    found.append(int(pid))
    return found


def judged(told: dict[str, Any], commands: list[Arrival], witness: HostWitness) -> Run:
    """Return what the commands of a test came to."""
    between, motion = periods(commands), held(commands)
    times = np.array([arrival.time for arrival in commands])
    quiet, off = ~witness.slow_during(times[:-1], times[1:]), np.abs(between - 0.005) > 1e-3
    first = next((i for i, arrival in enumerate(commands) if arrival.step >= told["steps"]), len(commands) - 1)
    return Run(
        told["outcome"],
        100.0 * float(np.mean(off)),
        100.0 * float(np.mean(off[quiet])) if quiet.any() else float("nan"),
        100.0 * float(np.mean(quiet)),
        1e3 * float(between[first - 1]),
        *(float(value) for value in motion),
        told["missed_deadlines"],
        told["steps"],
    )


def identify(answer_after: float, duration: float = 20.0) -> Run:
    """Drive the table of the controller with noise and return what arrived."""
    with HostWitness() as witness, ArrivalController(answer_after) as controller:
        options = ("--what", "table", "--order", "1", "--band", "1", "20", "--duration", str(duration), "--json")
        command = ["-m", "bmd_rths_nodes.cli.main", "identify", str(CONFIG), "--table", controller.address, *options]
        child = subprocess.run([sys.executable, *command], capture_output=True, text=True, timeout=300.0)
        if child.returncode:
            raise click.ClickException(child.stderr)
        stop = next(i for i, arrival in enumerate(controller.arrivals) if arrival.kind is Kind.STOP)
        commands = [arrival for arrival in controller.arrivals[:stop] if arrival.kind is Kind.COMMAND]
    return judged({"steps": 0, "outcome": "finished", "missed_deadlines": 0}, commands, witness)


def line(name: str, result: Run) -> str:
    wrong = "   emergency stop" if result.emergency else ""
    wrong += "   ended before" if result.ended_before else ""
    wrong += f"   WRONG: {', '.join(result.wrong)}: {result.told}" if result.wrong else ""
    return (
        f"{name:<28}{result.outcome:<10}{result.off_percent:7.2f} %{result.quiet_off_percent:7.2f} % of"
        f"{result.quiet_percent:4.0f} %{result.first_ms:8.2f} ms"
        f"{1e3 * result.velocity:10.4f} mm/s{1e3 * result.displacement:9.4f} mm"
        f"{1e3 * result.largest_displacement:8.1f} mm{result.missed:6d} of {result.steps}{wrong}"
    )


def counts(results: list[Run]) -> str:
    """Return how many tests came to what; each is counted once before the semicolon."""
    before = sum(result.ended_before for result in results)
    wrong = sum(bool(result.wrong) for result in results)
    return f"{len(results)} tests: {len(results) - before} in time, {before} ended before; {wrong} wrong"


@click.command(epilog="Example: python benchmarks/by_the_clock.py --aborts 20 --seed 1")
@click.option("--aborts", default=0, help="Random aborts instead of the table.")
@click.option("--seed", default=0, help="Seed of everything random.")
@click.option("--set", "given", multiple=True, help="Parameter of every run, as for `bmd-rths run`.")
@click.option("--mode", "modes", multiple=True, type=click.Choice(list(MODES)), help="One mode only.")
def main(aborts: int, seed: int, given: tuple[str, ...], modes: tuple[str, ...]) -> None:
    """Measure at the far end of the wire; exit status 1 when something did not hold."""
    rng, results = random.Random(seed), []
    chosen = modes or tuple(MODES)
    print(
        f"{'':<28}{'outcome':<10}{'off 1 ms':>9}{'host quiet':>18}{'first':>11}{'velocity':>15}{'displacement':>12}"
        f"{'peak':>11}  missed"
    )
    if aborts:
        cases = [(rng.choice(chosen), rng.choice((0.5e-3, 2e-3)), rng.choice(ENDINGS[1:])) for _ in range(aborts)]
    else:
        answers = {"composed": (0.5e-3, 2e-3, 4e-3), "five": (0.5e-3, 2e-3)}
        cases = [(mode, answer, ending) for mode in chosen for answer in answers[mode] for ending in ENDINGS]
    for mode, answer, ending in cases:
        result = run(mode, answer, ending, rng, given)
        results.append(result)
        print(line(f"{mode} {1e3 * answer:g} ms {ending}", result), flush=True)
    if not aborts:
        for answer in (0.5e-3, 2e-3, 4e-3):
            result = identify(answer)
            results.append(result)
            print(line(f"identify {1e3 * answer:g} ms", result), flush=True)
    print(counts(results))
    sys.exit(1 if any(result.wrong for result in results) else 0)


if __name__ == "__main__":
    main()
