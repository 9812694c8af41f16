"""Every compensator on the same work: errors, capture, peaks and cost, beside the least error that is possible.

Records (those of `benchmarks/campaign.py --list`, every second one to be held out from tuning; the present settings of
mpic are older than this split and were tuned on all of them), the simplified BMD and the 8-story building with the
whole shear, load cells and accelerometers, without the limits of the supervisor. What a compensator knows is identified
first, from a driven table. Real records are needed:

    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/compensators.py
    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/compensators.py --schemes mpic --seeds 0,1,2

The *bound* beside every result is that of `benchmarks/capture_bound.py`: the least noise of a causal compensator with
these sensors, exact models and a table that follows exactly, at the mean capture of the compensator, over the root mean
square of the response of the true building. What is beyond it are errors of the models and of the table, and noise that
a better filter would not have. *Reached* is the bound over the error. The bound knows nothing of the error that a small
capture makes as soon as the specimen is not its model. The cost is that of `step` and `learn`, a step.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import click
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from campaign import HIGH_PASS_HZ, RECORDS, list_of_records, write_list
from capture_bound import FrontPoint, front, least_noise

from bmd_rths_core.analysis.capture import captures
from bmd_rths_core.analysis.metrics import references_of
from bmd_rths_core.analysis.quality import KEYS, run_quality
from bmd_rths_core.analysis.table_peaks import peak
from bmd_rths_core.analysis.true_building import true_references_of
from bmd_rths_core.campaign.engine import SelectedMotion, run_motions
from bmd_rths_core.campaign.motions import read_motions
from bmd_rths_core.compensators.registry import compensators
from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.ground_motion.config import prepare_ground_motion
from bmd_rths_core.identification.excitation import ExcitationSettings, excitation_command
from bmd_rths_core.identification.excited_table import drive
from bmd_rths_core.identification.joint_model import identify_joint
from bmd_rths_core.identification.specimen_model import identify_specimen
from bmd_rths_core.identification.table_model import identify_table
from bmd_rths_core.loop.build import make_command_shaper, make_numerical_stage, make_supervisor, make_table_controller
from bmd_rths_core.table.controller import TableMeasurement

FOLDER = Path(__file__).parents[1] / "config"
BUILDINGS = {"simplified": "simplified_bmd.yaml", "8-story": "eight_story_bmd.yaml"}
SENSORS = {"load cells": "load_cell", "accelerometers": "kalman"}
BAND = (2.0 * np.pi * 0.5, 2.0 * np.pi * 25.0)
DELAY_BAND = (2.0 * np.pi * 0.5, 2.0 * np.pi * 8.0)
WITHOUT_LIMITS = {
    f"safety__{limit}_action": "ignore"
    for limit in ("displacement", "velocity", "acceleration", "force", "increment", "tracking", "stability")
}


def base(building: str) -> Config:
    """Return the configuration of a building with the whole shear."""
    config = load_config(FOLDER / BUILDINGS[building])
    return config.changed(
        force_correction__feedback_scale=1.0, ground_motion__high_pass_frequency=HIGH_PASS_HZ, **WITHOUT_LIMITS
    )


def identified(config: Config) -> Config:
    """Return the configuration with the models that were identified on its simulated table."""
    settings = ExcitationSettings(duration=240.0, seed=config.run.seed)
    commands = excitation_command(settings, config.run.time_step)
    responses = drive(make_table_controller(config), make_supervisor(config), commands, config.run.time_step)
    specimen = identify_specimen(responses, config.specimen.masses, BAND)
    model = identify_joint(responses, identify_table(responses, BAND, DELAY_BAND), specimen, BAND)
    values = model.parameters()["identified_model"]
    return config.changed(**{f"identified_model__{name}": value for name, value in values.items()})


def exact(config: Config) -> Config:
    """Return the configuration whose identified model is the truth of its simulated table."""
    table, truth = config.simulated_table, config.simulated_table.specimen(config.specimen.building())
    names = ("servo_real_pole", "servo_frequency", "servo_damping_ratio", "platen_mass")
    servo = table.dynamics == "interacting_servo"
    values: dict[str, Any] = {"table": "interacting_servo", "gain": 1.0, **{n: getattr(table, n) for n in names}}
    if not servo:
        values = {"table": "sections", "sections": table.own_sections}
    values |= {"command_delay": table.command_delay, "stiffnesses": truth.stiffnesses}
    values |= {"damping_coefficients": truth.damping_coefficients, "acceleration_noise": table.acceleration_noise}
    values |= {"displacement_noise": table.displacement_noise, "shear_noise": table.shear_noise}
    return config.changed(**{f"identified_model__{name}": value for name, value in values.items()})


def cost_of_a_step(config: Config, ground: np.ndarray) -> float:
    """Return the time of control or numerical substructure and shaper together, learning included, a step [µs]."""
    stage, shaper = make_numerical_stage(config, ground), make_command_shaper(config)
    stage.reset()
    shaper.reset()
    n, demanded = len(config.specimen.masses), 2 if config.compensator.control is not None else 0
    steps = ground[:2000].tolist()
    told = [TableMeasurement(k, 0.0, 0.0, a, 0.0, 0.0, np.full(n, a)) for k, a in enumerate(steps)]
    begin = time.perf_counter()
    for acceleration, measurement in zip(steps, told, strict=True):
        shaper.step(stage.step(acceleration, 0.0)[demanded])
        stage.learn(measurement)
        shaper.learn(measurement)
    return 1e6 * (time.perf_counter() - begin) / len(steps)


def judged(
    config: Config, motions: list[SelectedMotion], points: tuple[list[FrontPoint], list[FrontPoint]]
) -> list[dict[str, Any]]:
    """Return what a compensator reaches on every record."""
    grounds = [selected.motion.acceleration for selected in motions]
    nominal = references_of(grounds, config)
    references = true_references_of(grounds, config, nominal)
    shares = captures(config, grounds)
    lower = len(config.numerical_substructure.masses)
    means = np.mean([tuple(share) for share in shares], axis=0)
    least = [least_noise(own, mean) for own, mean in zip(points, means.tolist(), strict=True)]
    rows = []
    for i, run in enumerate(run_motions(config, motions)):
        record, reference = run.record, references[i]
        quality = run_quality(record, config, reference[: record.steps], shares[i])
        size = [float(np.sqrt(np.mean(reference[:, column] ** 2))) for column in (lower - 1, -1)]
        rows.append(
            {
                "motion": RECORDS[i],
                "held_out": bool(i % 2),
                "stable": record.stable and bool(np.abs(record.command).max() < 1e3),
                "rmse_true_percent": {name: quality.rmse_true_percent[name] for name in KEYS},
                "rmse_clean_percent": {name: quality.rmse_clean_percent[name] for name in KEYS},
                "bound_percent": {n: 100.0 * e / s for n, e, s in zip((KEYS[0], KEYS[2]), least, size, strict=True)},
                "capture": shares[i]._asdict(),
                "tracking_error_percent": quality.tracking.error_percent,
                "peak_command": peak(record.command),
                "peak_displacement": peak(record.table_displacement),
                "verdict": quality.judgement.verdict,
            }
        )
    return rows


def motions_of(config: Config, records: int) -> list[SelectedMotion]:
    """Return the first records of the list, ready for the loop."""
    with tempfile.TemporaryDirectory() as folder:
        read = read_motions(write_list(Path(folder))).motions[:records]
    selections = [motion.select(config.ground_motion) for motion in read]
    return [
        SelectedMotion(selection, prepare_ground_motion(motion.motion, selection, config.run.time_step))
        for motion, selection in zip(read, selections, strict=True)
    ]


def summary(rows: list[dict[str, Any]]) -> str:
    """Return means and worst of some records, as cells of a table."""
    if not all(row["stable"] for row in rows):
        return f"unstable in {sum(not row['stable'] for row in rows)} of {len(rows)}"

    def cell(of: str, name: str) -> str:
        values = [row[of][name] for row in rows]
        return f"{np.mean(values):.1f} ({np.max(values):.1f})"

    def reached(name: str, of: str) -> str:
        shares = [row["bound_percent"][name] / row[of][name] for row in rows]
        return f"{np.mean(shares):.2f}"

    sub, top = KEYS[0], KEYS[2]
    shares = [[row["capture"][name] for row in rows] for name in (sub, top)]
    capture = ", ".join(f"{np.mean(own):.2f} ({np.min(own):.3f})" for own in shares)
    cells = (cell("rmse_true_percent", sub), cell("bound_percent", sub), reached(sub, "rmse_true_percent"))
    cells += (cell("rmse_clean_percent", top), cell("bound_percent", top), reached(top, "rmse_clean_percent"))
    cells += (cell("rmse_true_percent", top), capture)
    cells += (
        f"{max(row['peak_command'] for row in rows):.2f}",
        f"{1e3 * max(row['peak_displacement'] for row in rows):.0f}",
    )
    return " | ".join(cells)


@click.command()
@click.option("--schemes", default="", help="Compensators; by default those of the paper and every registered one.")
@click.option("--buildings", default=",".join(BUILDINGS), show_default=True)
@click.option("--sensors", default=",".join(SENSORS), show_default=True)
@click.option("--seeds", default="0", show_default=True, help="Seeds of the noise, also of the identification.")
@click.option("--records", type=int, default=len(RECORDS), show_default=True, help="How many of the records.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def main(schemes: str, buildings: str, sensors: str, seeds: str, records: int, as_json: bool) -> None:
    """Print the table."""
    list_of_records()  # refuses before anything is identified
    names = schemes.split(",") if schemes else list(dict.fromkeys((*SCHEME_NAMES, *compensators())))
    told: list[dict[str, Any]] = []
    head = "sub | bound | reached | super, clean | bound | reached | super, raw | capture (least), sub and super"
    head += " | command m/s² | table mm | µs"
    for building in buildings.split(","):
        for seed in map(int, seeds.split(",")):
            config = identified(base(building).changed(run__seed=seed))
            motions = motions_of(config, records)
            grounds = [selected.motion.acceleration for selected in motions]
            for sensor in sensors.split(","):
                sensed = config.changed(shear_estimator__source=SENSORS[sensor])
                points = front(exact(sensed.changed(run__scheme="mpic")), grounds)
                if not as_json:
                    print(f"\n{building}, {sensor}, seed {seed}\nscheme, records | {head}", flush=True)
                for scheme in names:
                    chosen = sensed.changed(run__scheme=scheme)
                    rows = judged(chosen, motions, points)
                    cost = cost_of_a_step(chosen, grounds[0])
                    told.append({"building": building, "sensors": sensor, "seed": seed, "scheme": scheme})
                    told[-1] |= {"cost_us": cost, "runs": rows}
                    if as_json:
                        continue
                    for name, kept in (("tuning", False), ("held out", True)):
                        some = [row for row in rows if row["held_out"] == kept]
                        if some:
                            print(f"{scheme}, {name} | {summary(some)} | {cost:.0f}", flush=True)
    if as_json:
        print(json.dumps({"results": told}))


if __name__ == "__main__":
    main()
