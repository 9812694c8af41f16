"""What a bigger problem costs: a step against stories and states, a campaign against runs, a bag against hours.

    python benchmarks/scale.py                       # steps, campaigns to 1,000 runs, bags to 0.25 h: some minutes
    python benchmarks/scale.py --only steps          # one of steps, campaign, bag
    python benchmarks/scale.py --runs 100000         # campaigns to 100,000 runs
    python benchmarks/scale.py --dask                # campaigns on two local Dask workers instead of in this process

Each line has the exponent of the power law from the line before it, d log(cost) / d log(size): 0 where something else
costs, 1 where the cost is proportional. Where it changes is where the cost bends.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

# Small matrices: threads of the linear algebra wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click
import numpy as np

from bmd_rths_core.campaign.motions import CampaignMotion
from bmd_rths_core.campaign.study import Study
from bmd_rths_core.compensators.linear_shaper import LinearShaper
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.library import read_ground_motion
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.loop.build import make_numerical_substructure
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.record import RunRecord
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_nodes.campaign import pool

CONFIG = Path(__file__).parents[1] / "config" / "simplified_bmd.yaml"
STORIES = (1, 2, 5, 10, 20, 50, 100, 200)
STATES = (2, 5, 10, 20, 50, 100, 200, 400)
HOURS = (0.01, 0.03, 0.1, 0.25, 1.0)

#: Steps of a measurement, and how often it is repeated; the best counts, the others were disturbed.
_STEPS, _REPEATS = 2000, 5

Row = dict[str, float]


def microseconds(step: Callable[[], Any]) -> float:
    """Return the processor time of one call [µs]: what else the machine does counts less in it."""
    best = math.inf
    for _ in range(_REPEATS):
        begin = time.process_time()
        for _ in range(_STEPS):
            step()
        best = min(best, time.process_time() - begin)
    return 1e6 * best / _STEPS


def tall(stories: int) -> Config:
    """Return the simplified BMD on a numerical substructure of many stories, as stiff and heavy as its one."""
    config = load_config(CONFIG)
    lower = config.numerical_substructure
    one = (lower.masses[-1], lower.stiffnesses[-1], lower.damping_coefficients[-1])
    names = ("masses", "stiffnesses", "damping_coefficients")
    changes = {f"numerical_substructure__{name}": (value,) * stories for name, value in zip(names, one, strict=True)}
    limits = ("displacement", "velocity", "acceleration", "force", "increment", "tracking", "stability")
    without = {f"safety__{limit}_action": "ignore" for limit in limits}
    return config.changed(**changes, **without, run__scheme="uc", ground_motion__duration=5.0)


def against_stories() -> Iterator[Row]:
    """Yield the cost of the numerical substructure alone and of the whole loop [µs a step]."""
    for stories in STORIES:
        config = tall(stories)
        numerical = make_numerical_substructure(config)
        alone = microseconds(lambda numerical=numerical: numerical.step(0.1, 10.0))
        motion = select_ground_motion(config.ground_motion, config.run.time_step)
        loop, best = RthsLoop(config, motion), math.inf
        for _ in range(_REPEATS):
            begin = time.process_time()
            record = loop.run()
            best = min(best, time.process_time() - begin)
        yield {"stories": stories, "substructure [µs]": alone, "loop [µs]": 1e6 * best / record.steps}


def against_states() -> Iterator[Row]:
    """Yield the cost of a linear compensator [µs a step]."""
    for states in STATES:
        random = np.random.default_rng(states)
        a = random.standard_normal((states, states))
        a *= 0.9 / np.abs(np.linalg.eigvals(a)).max()
        column = random.standard_normal((states, 1))
        shaper = LinearShaper(DiscreteStateSpace(a, column, column.T, np.ones((1, 1))))
        yield {"states": states, "compensator [µs]": microseconds(lambda shaper=shaper: shaper.step(0.1))}


def against_runs(most: int, dask: bool) -> Iterator[Row]:
    """Yield time and memory of campaigns of El Centro, 8 s, by the seed."""
    config = load_config(CONFIG).changed(ground_motion__duration=8.0)
    motion = CampaignMotion("el_centro_1940_ns", "only", "from_file", read_ground_motion("el_centro_1940_ns"))
    with cluster() if dask else contextlib.nullcontext("") as address:
        for runs in itertools.takewhile(lambda runs: runs <= most, (10, 100, 1000, 10_000, 100_000)):
            study = Study(config, [motion], ["uc"], {"run.seed": range(runs)})
            begin, run = time.perf_counter(), pool.PieceRunner(None)
            pieces = study.pieces()
            finished = pool.on_cluster(pieces, run, address) if dask else pool.in_process(pieces, run)
            done = sum(len(piece) for piece in finished)
            seconds = time.perf_counter() - begin
            yield {"runs": done, "time [s]": seconds, "a run [ms]": 1e3 * seconds / done, "memory [MB]": memory()}


@contextlib.contextmanager
def cluster() -> Iterator[str]:
    """Start two Dask workers of this machine, each a process with one thread."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        yield local.scheduler_address


def against_hours(most: float) -> Iterator[Row]:
    """Yield size of a bag, and the times to write and to read it."""
    config = load_config(CONFIG).changed(run__scheme="uc", ground_motion__duration=10.0)
    short = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    for hours in itertools.takewhile(lambda hours: hours <= most, HOURS):
        record = lengthened(short, round(hours * 3600.0 / short.time_step))
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            bag = write_record(record, Path(folder) / "bag")
            written = time.perf_counter()
            same = read_bag(bag).same_signals(record)
            read = time.perf_counter() - written
            size = sum(path.stat().st_size for path in bag.iterdir())
        if not same:
            raise RuntimeError("the bag has other signals than the run")
        row = {"hours": hours, "size [MB]": 1e-6 * size, "write [s]": written - begin, "read [s]": read}
        yield {**row, "memory [MB]": memory()}


def lengthened(record: RunRecord, steps: int) -> RunRecord:
    """Return a record of as many steps, the signals repeated."""
    import dataclasses

    rows = np.arange(steps) % record.steps
    return dataclasses.replace(record, **{name: signal[rows] for name, signal in record.signals().items()})


def memory() -> float:
    """Return the largest memory this process has had so far [MB]."""
    return 1e-3 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def show(title: str, rows: Sequence[Row]) -> None:
    """Print a table, with the exponent of every cost from the row before."""
    size, *costs = rows[0]
    print(f"\n| {size} | " + " | ".join(f"{name} | exponent" for name in costs) + " |")
    print("|" + "---|" * (1 + 2 * len(costs)))
    before: Row | None = None
    for row in rows:
        cells = [f"{row[size]:g}"]
        for name in costs:
            grown = "" if before is None else f"{_exponent(before, row, size, name):.2f}"
            cells += [f"{row[name]:.3g}", grown]
        print("| " + " | ".join(cells) + " |")
        before = row
    print(f"({title})")


def _exponent(before: Row, now: Row, size: str, cost: str) -> float:
    return math.log(now[cost] / before[cost]) / math.log(now[size] / before[size])


@click.command()
@click.option("--only", type=click.Choice(["steps", "campaign", "bag"]), help="Measure this alone.")
@click.option("--runs", default=1000, show_default=True, help="Largest campaign.")
@click.option("--hours", default=0.25, show_default=True, help="Longest bag.")
@click.option("--dask", is_flag=True, help="Run the campaigns on two local Dask workers.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def main(only: str | None, runs: int, hours: float, dask: bool, as_json: bool) -> None:
    """Measure how the costs grow."""
    where = "two Dask workers" if dask else "one process"
    measured: dict[str, list[Row]] = {}
    for name, title, rows in (
        ("steps", "a step against stories of the numerical substructure", against_stories()),
        ("steps", "a step of a compensator against its states", against_states()),
        ("campaign", f"campaigns of El Centro, 8 s, in {where}", against_runs(runs, dask)),
        ("bag", "bags of 200 Hz", against_hours(hours)),
    ):
        if only in (None, name):
            measured[title] = list(rows)
            if not as_json:
                show(title, measured[title])
    if as_json:
        print(json.dumps(measured))


if __name__ == "__main__":
    sys.exit(main())
