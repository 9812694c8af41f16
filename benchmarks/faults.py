"""Fault campaign: random faults by seed, in virtual time and with real processes, and a table of what they came to.

After every fault the table has to be at rest within its ramp time, no hard limit may have been passed by more than a
step's motion, the reason has to be told, the bag has to open, and no process may be left. The kinds take turns;
docs/explanation/faults.md has the results. Run it with

    python benchmarks/faults.py                       # 246 faults, twenty minutes or more
    python benchmarks/faults.py --count 20 --processes 0 --only loss --seed 3 --json
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import cycle, islice
from pathlib import Path

import click
from rich.progress import Progress

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.faults import in_process, processes
from tests.faults.outcome import Outcome, summary

ENDS = ("finished", "limit", "failed", "stopped", "cut", "no bag", "wrong")


def faults(kinds: dict[str, object], only: tuple[str, ...], count: int, seed: int) -> Iterator[tuple[str, int]]:
    """Yield kind and seed, the kinds taking turns."""
    chosen = [kind for kind in kinds if not only or kind in only]
    return ((kind, seed + number // len(chosen)) for number, kind in enumerate(islice(cycle(chosen), count)))


def with_processes(kind: str, seed: int) -> Outcome:
    with tempfile.TemporaryDirectory(prefix="faults_") as folder:
        return processes.outcome_of(kind, seed, Path(folder))


def tell(seed: int, outcome: Outcome) -> None:
    """Tell an outcome on standard error."""
    wrong = f"\n    WRONG: {'; '.join(outcome.wrong)}" if outcome.wrong else ""
    print(f"{outcome.kind} {seed}: {outcome.fault}: {outcome.ended}, {outcome.reason}{wrong}", file=sys.stderr)


@click.command()
@click.option("--count", default=200, help="Faults in virtual time.")
@click.option("--processes", "process_count", default=46, help="Faults of real processes.")
@click.option("--seed", default=0, help="Seed of everything random.")
@click.option("--only", multiple=True, metavar="KIND", help="This kind of fault only; may be repeated.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def main(count: int, process_count: int, seed: int, only: tuple[str, ...], as_json: bool) -> None:
    """Run the fault campaign; exit status 1 when something did not hold."""
    unknown = set(only) - set(in_process.KINDS) - set(processes.KINDS)
    if unknown:
        raise click.BadParameter(
            f"{', '.join(sorted(unknown))}; one of {', '.join(in_process.KINDS | processes.KINDS)}"
        )
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100))
    begin = time.perf_counter()
    outcomes = []
    with Progress(transient=True, disable=not sys.stderr.isatty()) as progress:
        for kinds, number, run in (
            (in_process.KINDS, count, in_process.outcome_of),
            (processes.KINDS, process_count, with_processes),
        ):
            for kind, own_seed in progress.track(list(faults(kinds, only, number, seed)), description="faults"):
                outcomes.append(run(kind, own_seed))
                tell(own_seed, outcomes[-1])
    table = summary(outcomes)
    if as_json:
        print(json.dumps({"summary": table, "outcomes": [outcome.as_mapping() for outcome in outcomes]}))
    else:
        print(f"| kind | {' | '.join(ENDS)} |\n|---{'|---' * len(ENDS)}|")
        for kind, ends in table.items():
            print(f"| `{kind}` | {' | '.join(str(ends[end] or '–') for end in ENDS)} |")
        print(f"{len(outcomes)} faults, {time.perf_counter() - begin:.0f} s")
    sys.exit(any(outcome.wrong for outcome in outcomes))


if __name__ == "__main__":
    main()
