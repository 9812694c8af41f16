"""A specimen that softens or yields during the test: what MPIC makes of it, beside a simulation that does not know.

The simplified BMD under every record of `benchmarks/campaign.py --list`, with models that were identified before the
test. The specimen softens to 0.8 of its stiffness at a quarter of the Arias intensity, or its stories yield at half of
the drift that they would have, with 0.3 of their stiffness left. Errors are those against the building with that
specimen; *pure simulation* is the building with the identified one. Real records are needed:

    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/damage.py
    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/damage.py --damage yields --records 4
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from campaign import RECORDS, list_of_records
from compensators import BUILDINGS, base, identified, motions_of

from bmd_rths_core.analysis.metrics import references_of, rmse_percent
from bmd_rths_core.analysis.quality import KEYS, run_quality
from bmd_rths_core.analysis.true_building import simulated_references_of
from bmd_rths_core.campaign.engine import run_motions
from bmd_rths_core.config import Config
from bmd_rths_core.integration.discretisation import DiscreteStateSpace, first_order_hold
from bmd_rths_core.integration.linear_simulation import LinearSimulation

SOFTENED, INTENSITY, YIELDS_AT, RATIO = 0.8, 0.25, 0.5, 0.3
OPTIONS = {
    "load cells": {"shear_estimator__source": "load_cell"},
    "load cells, stiffness": {"shear_estimator__source": "load_cell", "mpic__stiffness": True},
    "accelerometers": {},
    "accelerometers, stiffness": {"mpic__stiffness": True},
}


def softening(config: Config, ground: np.ndarray) -> Config:
    """Return the configuration whose specimen softens at a share of the Arias intensity."""
    intensity = np.cumsum(ground**2)
    step = int(np.searchsorted(intensity, INTENSITY * intensity[-1]))
    time = step * config.run.time_step
    return config.changed(simulated_table__softening_factor=SOFTENED, simulated_table__softening_time=time)


def yielding(config: Config, ground: np.ndarray) -> Config:
    """Return the configuration whose stories yield at a share of their largest elastic drift."""
    specimen = config.simulated_table.specimen(config.specimen.building())
    lower = config.numerical_substructure.building()
    whole = specimen.stacked_on(lower)
    a, b, _ = whole.relative_motion()
    transition, before, now = first_order_hold(a, b, config.run.time_step)
    drifts = np.diff(np.eye(whole.stories, 2 * whole.stories), axis=0)[lower.stories - 1 :]
    system = DiscreteStateSpace(transition, transition @ now + before, drifts, drifts @ now)
    simulation = LinearSimulation(system, -now * ground[0])
    largest = np.abs(simulation.advance(ground[:, None])[0]).max(axis=1)
    drifts_at_yield = (YIELDS_AT * largest).tolist()
    return config.changed(simulated_table__yield_drifts=drifts_at_yield, simulated_table__post_yield_ratio=RATIO)


DAMAGES = {"softens": softening, "yields": yielding}


@click.command()
@click.option("--building", type=click.Choice(list(BUILDINGS)), default="simplified", show_default=True)
@click.option("--damage", type=click.Choice(list(DAMAGES)), multiple=True, help="What happens; both by default.")
@click.option("--options", default=";".join(OPTIONS), show_default=True, help="Sensors and adaptation.")
@click.option("--records", type=int, default=len(RECORDS), show_default=True, help="How many of the records.")
def main(building: str, damage: tuple[str, ...], options: str, records: int) -> None:
    """Print the table."""
    list_of_records()
    config = identified(base(building)).changed(run__scheme="mpic")
    lower = len(config.numerical_substructure.masses)
    print("specimen, sensors | substructure | control layer | superstructure, clean; mean (worst) %")
    for name in damage or DAMAGES:
        errors: dict[str, list[list[float]]] = {}
        for selected in motions_of(config, records):
            ground = selected.motion.acceleration
            real = DAMAGES[name](config, ground)
            (true,) = simulated_references_of([ground], real)
            (pure,) = references_of([ground], real, real.identified_model.specimen(real.specimen.building()))
            of_pure = [rmse_percent(true[:, i], pure[:, i]) for i in (lower - 1, lower, -1)]
            errors.setdefault("pure simulation", []).append(of_pure)
            for option in options.split(";"):
                chosen = real.changed(**OPTIONS[option])
                (run,) = run_motions(chosen, [selected])
                quality = run_quality(run.record, chosen, true[: run.record.steps])
                errors.setdefault(option, []).append([quality.rmse_clean_percent[key] for key in KEYS])
        for option, rows in errors.items():
            means, worst = np.mean(rows, axis=0), np.max(rows, axis=0)
            cells = " | ".join(f"{mean:.1f} ({most:.1f})" for mean, most in zip(means, worst, strict=True))
            print(f"{name}, {option} | {cells}", flush=True)


if __name__ == "__main__":
    main()
