"""By the clock: when commands arrive at a controller on UDP, and where they lead its table, for every ending of a test.

The product runs as a person starts it, in real time, against a controller in this process whose packets are stamped by
the kernel (tests/clock/arrivals.py). Each command counts for the time it was really held. Run it with

    python benchmarks/by_the_clock.py                 # the table: every mode, answer and ending
    python benchmarks/by_the_clock.py --aborts 200    # random aborts by seed, in real time
"""

from __future__ import annotations

import json
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
from tests.clock.arrivals import Arrival, ArrivalController, held, periods

CONFIG = Path(__file__).parents[1] / "config" / "simplified_bmd.yaml"
MODES = {"composed": ("--composed",), "five": ()}
PROCESSES = {"composed": ("composed_loop",), "five": ("numerical_substructure", "table_driver", "shear_estimator")}
ENDINGS = ("end", "driver", "indicator", "ctrl-c", "stall")

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

    @property
    def wrong(self) -> list[str]:
        """What does not hold, but for a stall, which may lead anywhere."""
        limits, found = Config().safety, []
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
        if ending in ("ctrl-c", "stall"):
            abort(child, controller, ending, mode, rng, duration)
        output, errors = child.communicate(timeout=120.0)
        if not output:
            raise click.ClickException(f"{' '.join(command)}: {errors}")
        told: dict[str, Any] = json.loads(output)
        commands = controller.commands
        emergency = any(arrival.kind is Kind.EMERGENCY_STOP for arrival in controller.arrivals)
    words = " | ".join([told["reason"], *errors.splitlines()])
    return judged(told, commands, witness)._replace(emergency=emergency, told=words)


def abort(
    child: Any, controller: ArrivalController, ending: str, mode: str, rng: random.Random, duration: float
) -> None:
    """Interrupt the test, or hold one of its processes up, at a random time."""
    begin = time.monotonic() + 60.0
    while not controller.commands and child.poll() is None and time.monotonic() < begin:
        time.sleep(0.005)
    time.sleep(rng.uniform(0.1, 0.8 * duration))
    if ending == "ctrl-c":
        child.send_signal(signal.SIGINT)
        return
    name = f"nodes.{rng.choice(PROCESSES[mode])}"
    found = [pid for pid in descendants(child.pid) if name in Path(f"/proc/{pid}/cmdline").read_text()]
    for pid in found:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(rng.uniform(0.05, 0.5))
    for pid in found:
        os.kill(pid, signal.SIGCONT)


def descendants(parent: int) -> list[int]:
    """Return the children of a process."""
    listed = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [int(pid) for pid in listed]


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
    wrong += f"   WRONG: {', '.join(result.wrong)}: {result.told}" if result.wrong else ""
    return (
        f"{name:<28}{result.outcome:<10}{result.off_percent:7.2f} %{result.quiet_off_percent:7.2f} % of"
        f"{result.quiet_percent:4.0f} %{result.first_ms:8.2f} ms"
        f"{1e3 * result.velocity:10.4f} mm/s{1e3 * result.displacement:9.4f} mm"
        f"{1e3 * result.largest_displacement:8.1f} mm{result.missed:6d} of {result.steps}{wrong}"
    )


@click.command(epilog="Example: python benchmarks/by_the_clock.py --aborts 20 --seed 1")
@click.option("--aborts", default=0, help="Random aborts instead of the table.")
@click.option("--seed", default=0, help="Seed of everything random.")
@click.option("--set", "given", multiple=True, help="Parameter of every run, as for `bmd-rths run`.")
@click.option("--mode", "modes", multiple=True, type=click.Choice(list(MODES)), help="One mode only.")
def main(aborts: int, seed: int, given: tuple[str, ...], modes: tuple[str, ...]) -> None:
    """Measure at the far end of the wire; exit status 1 when something did not hold."""
    rng, wrong = random.Random(seed), 0
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
        wrong += bool(result.wrong)
        print(line(f"{mode} {1e3 * answer:g} ms {ending}", result), flush=True)
    if not aborts:
        for answer in (0.5e-3, 2e-3, 4e-3):
            result = identify(answer)
            wrong += bool(result.wrong)
            print(line(f"identify {1e3 * answer:g} ms", result), flush=True)
    print(f"{wrong} wrong")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
