"""Two ways to run the same test in real time, in turn: what the second costs in closure and missed deadlines.

Run it with

    python benchmarks/side_by_side.py watched      # page and browser, against neither; the recorder is in both
    python benchmarks/side_by_side.py mpic         # model-predictive interface control, against the phase lead

Composed nodes, the simulated table, 200 Hz. A ratio travels, milliseconds do not; on a host that takes its processors
away for a while both sides miss deadlines.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.nodes.browser import CHROMIUM, MISSING, chromium

CONFIG = Path(__file__).parents[1] / "config" / "simplified_bmd.yaml"

#: So that a slow host does not end a test before its steps are counted.
PATIENT = ("run.longest_miss_time=10.0", "safety.stale_shear_time=10.0", "run.preflight=skip")

LOAD_CELLS = ("--set", "shear_estimator.source=load_cell")

#: What is compared: names and options of both sides.
PAIRS: dict[str, tuple[tuple[str, tuple[str, ...]], tuple[str, tuple[str, ...]]]] = {
    "watched": (("alone", ()), ("page and browser", ("--monitor",))),
    "mpic": (("plc", ("--scheme", "plc", *LOAD_CELLS)), ("mpic", ("--scheme", "mpic", *LOAD_CELLS))),
}

ADDRESS = re.compile(r"watch the test at (http://\S+)")


def run(options: tuple[str, ...], seconds: float, browser: Any) -> dict[str, Any]:
    """Run a test, with its page open in the browser where it has one, and return what it tells."""
    settings = [word for pair in (*PATIENT, f"ground_motion.duration={seconds!r}") for word in ("--set", pair)]
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    environment.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    with tempfile.TemporaryDirectory(prefix="side_by_side_") as folder, ExitStack() as stack:
        arguments = ["run", str(CONFIG), "--composed", "--json", "--output", folder, *settings, *options]
        child = stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-m", "bmd_rths_nodes.cli.main", *arguments],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env=environment,
            )
        )
        assert child.stdout is not None
        assert child.stderr is not None
        if "--monitor" in options:
            address = next(found[1] for line in child.stderr if (found := ADDRESS.search(line)))
            asyncio.run(watched(browser, address, child))
        told = json.loads(child.stdout.read() or "{}")
        if "closure_ms" not in told:
            raise click.ClickException(f"{' '.join(arguments)}: {child.stderr.read()}")
    return {key: told[key] for key in ("closure_ms", "missed_deadlines", "steps", "outcome")}


async def watched(browser: Any, address: str, child: subprocess.Popen[str]) -> None:
    """Look at a page until its run has ended."""
    page = await browser(address, 1920, 1080, "dark")
    while child.poll() is None:
        await asyncio.sleep(0.2)
    if page.complaints:
        raise click.ClickException(f"the page: {page.complaints}")


@click.command()
@click.argument("pair", type=click.Choice(list(PAIRS)))
@click.option("--seconds", default=17.0, show_default=True, help="Length of a test [s].")
@click.option("--repeats", default=3, show_default=True, help="Tests of each side.")
def main(pair: str, seconds: float, repeats: int) -> None:
    """Run both sides in turn and print a table."""
    if pair == "watched" and CHROMIUM is None:
        raise click.ClickException(MISSING)
    sides = PAIRS[pair]
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name, _ in sides}
    with tempfile.TemporaryDirectory(prefix="browser_") as folder, ExitStack() as stack:
        browser = stack.enter_context(chromium(Path(folder))) if pair == "watched" else None
        for _ in range(repeats):
            for name, options in sides:
                runs[name].append(run(options, seconds, browser))
    print(f"{'closure of a step [ms]':<24}{'p50':>8}{'p99':>8}   missed")
    medians = {}
    for name, found in runs.items():
        p50, p99 = (statistics.median(one["closure_ms"][key] for one in found) for key in ("p50", "p99"))
        medians[name] = p50, p99
        missed, steps = (sum(one[key] for one in found) for key in ("missed_deadlines", "steps"))
        print(f"{name:<24}{p50:8.3f}{p99:8.3f}   {missed} of {steps}")
    (first, _), (second, _) = sides
    ratios = [after / before for before, after in zip(medians[first], medians[second], strict=True)]
    print(f"{second} to {first}: p50 x {ratios[0]:.2f}, p99 x {ratios[1]:.2f}")


if __name__ == "__main__":
    main()
