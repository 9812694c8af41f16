"""What sub-steps cost and gain: errors of the response and margins against N, and the time an integration may take.

    python benchmarks/substeps.py            # two rates, N to 10: a minute or two

All in process, with the simulated table and its noise. ω is the highest frequency of the numerical substructure. "Off"
is how far the response of the roof is from that without sub-steps, root mean square. The error is that against the
whole building. "Same Δt" is what N costs: the error over that without sub-steps at the same rate. "Same N Δt" is what
it gains: the error over that of a loop whose own time step is N Δt, which is what the same building has without them.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click
import numpy as np

from bmd_rths_core.analysis.metrics import compare, reference_of
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.integration.substeps import longest_integration
from bmd_rths_core.loop.build import make_integrated_stage
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.record import RunRecord
from bmd_rths_core.stability.discrete import discrete_margin
from bmd_rths_core.stability.substepped import substepped_margin

CONFIG = Path(__file__).parents[1] / "config" / "simplified_bmd.yaml"
RATES = (1024.0, 200.0)
SUBSTEPS = (1, 2, 4, 5, 8, 10)
COLUMNS = ("N", "N Δt ω", "allowed ms", "step µs", "radius", "margin", "off %", "error %", "same Δt", "same N Δt")


def run(config: Config) -> RunRecord:
    """Run a test in process."""
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


def off(record: RunRecord, plain: RunRecord) -> float:
    """Return how far the roof is from that of another test [%]; NaN where a limit has ended one."""
    if "limit" in (record.outcome, plain.outcome):
        return float("nan")
    roofs = record.floor_accelerations[:, -1], plain.floor_accelerations[:, -1]
    return float(100.0 * np.std(roofs[0] - roofs[1]) / np.std(roofs[1]))


def error_of(record: RunRecord, config: Config) -> float:
    """Return the error of the roof against the whole building [%]; NaN where a limit ends the test."""
    if record.outcome != "finished":
        return float("nan")
    metrics = compare(record, reference_of(record, config), len(config.numerical_substructure.masses))
    return metrics.rmse_percent["superstructure"]


def between_targets(config: Config) -> float:
    """Return the processor time of a step of the substructure in which no integration begins [µs], the median."""
    random = np.random.default_rng(0)
    steps, substeps = 4000, config.numerical_substructure.substeps
    ground, shear = random.normal(size=steps), random.normal(size=steps)
    stage = make_integrated_stage(config, ground)
    stage.reset()
    costs = []
    for k, (a, f) in enumerate(zip(ground.tolist(), shear.tolist(), strict=True)):
        begin = time.perf_counter()
        stage.step(a, f)
        if substeps == 1 or k % substeps:
            costs.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(costs))


def row(config: Config, plain: RunRecord) -> tuple[str, ...]:
    """Return the line of one N."""
    substeps, time_step = config.numerical_substructure.substeps, config.run.time_step
    record = run(config)
    error, without = error_of(record, config), error_of(plain, config)
    highest = float(config.elastic_substructure().modes().frequencies[-1])
    margin = (discrete_margin if substeps == 1 else substepped_margin)(config).allowable_mass_ratio
    try:
        slower = config.changed(numerical_substructure__substeps=1, run__time_step=substeps * time_step)
        error_of_slower = error_of(run(slower), slower)
    except InputError:  # another parameter forbids such a long step
        error_of_slower = float("nan")
    return (
        f"{substeps}",
        f"{highest * substeps * time_step:.2f}",
        f"{1e3 * longest_integration(substeps, time_step):.3g}",
        f"{between_targets(config):.1f}",
        f"{closed_loop(config).spectral_radius:.5f}",
        f"{margin:.3f}",
        f"{off(record, plain):.2f}",
        f"{error:.2f}",
        f"{error / without:.2f}",
        f"{error / error_of_slower:.2f}",
    )


@click.command()
@click.option("--scheme", default="plc_fc", show_default=True)
@click.option("--scale", default=1.0, show_default=True, help="Share of the shear that is fed back.")
@click.option("--duration", default=15.0, show_default=True, help="Of El Centro [s].")
def main(scheme: str, scale: float, duration: float) -> None:
    """Measure."""
    for rate in RATES:
        base = load_config(CONFIG).changed(
            run__time_step=1.0 / rate,
            run__scheme=scheme,
            ground_motion__duration=duration,
            ground_motion__resample=True,
            force_correction__feedback_scale=scale,
        )
        click.echo(f"{rate:g} Hz, {scheme}, share {scale:g}\n| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
        plain = run(base)
        for substeps in SUBSTEPS:
            config = base.changed(numerical_substructure__substeps=substeps)
            click.echo(f"| {' | '.join(row(config, plain))} |")


if __name__ == "__main__":
    sys.exit(main())
