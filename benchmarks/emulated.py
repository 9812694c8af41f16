"""MPIC on a table whose structure is not that of its model: the servo-hydraulic emulator over UDP, in lockstep.

The emulator is a process of its own. Its table is identified first, as a laboratory would do it, over the same socket;
then every record is run with what was identified, and the same record on the simulated table of the configuration. The
errors are those against the building with the specimen that stands on the table, the floors without the noise of their
sensors, which follows from the seed. Real records are needed:

    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/emulated.py --records 3
    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/emulated.py --building 8-story --records 1
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path

import click
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from campaign import RECORDS, list_of_records
from compensators import BAND, BUILDINGS, DELAY_BAND, base, identified, motions_of

from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.analysis.true_building import simulated_references_of
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.identification.excitation import ExcitationSettings, excitation_command
from bmd_rths_core.identification.excited_table import drive
from bmd_rths_core.identification.joint_model import identify_joint
from bmd_rths_core.identification.specimen_model import identify_specimen
from bmd_rths_core.identification.table_model import identify_table
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.config import LONGEST_ANSWER_TIMEOUT
from bmd_rths_core.table.models.sensors import noise_streams
from bmd_rths_nodes.cli.emulate import make_emulator
from bmd_rths_nodes.hardware.controllers import make_table_controller

OPTIONS = {
    "plc_fc": {"run__scheme": "plc_fc"},
    "mpic": {"run__scheme": "mpic"},
    "mpic, uncertain_table, trim": {
        "run__scheme": "mpic",
        "mpic__observer": "uncertain_table",
        "mpic__trim": True,
    },
}


def _serve(config: Config, port: Connection, ended: Event) -> None:
    """Be the emulator until the event is set."""
    emulator = make_emulator(config, "udp://127.0.0.1:0")
    port.send(emulator.port)
    emulator.run(ended.is_set)


@contextmanager
def emulated(config: Config) -> Iterator[Config]:
    """Run a fresh emulator in a process of its own; give the configuration that leads to it."""
    ours, theirs = multiprocessing.Pipe()
    ended = multiprocessing.Event()
    process = multiprocessing.Process(target=_serve, args=(config, theirs, ended))
    process.start()
    try:
        address = f"udp://127.0.0.1:{ours.recv()}"
        yield config.changed(
            table__controller="udp", table__address=address, table__answer_timeout=LONGEST_ANSWER_TIMEOUT
        )
    finally:
        ended.set()
        process.join()


def identified_over_udp(config: Config, duration: float) -> Config:
    """Return the configuration with the models that were identified on its emulator."""
    settings = ExcitationSettings(duration=duration, seed=config.run.seed)
    commands = excitation_command(settings, config.run.time_step)
    with emulated(config) as there:
        responses = drive(make_table_controller(there), make_supervisor(there), commands, config.run.time_step)
    specimen = identify_specimen(responses, config.specimen.masses, BAND)
    model = identify_joint(responses, identify_table(responses, BAND, DELAY_BAND), specimen, BAND)
    values = model.parameters()["identified_model"]
    print({name: value for name, value in values.items() if not name.endswith("deviations")}, flush=True)
    return config.changed(**{f"identified_model__{name}": value for name, value in values.items()})


def errors(config: Config, motion: GroundMotion, over_udp: bool) -> list[float]:
    """Return the errors of interface and highest floor without noise, and the peaks of command and table."""
    if over_udp:
        with emulated(config) as there:
            record = RthsLoop(there, motion, make_table_controller(there)).run()
    else:
        record = RthsLoop(config, motion).run()
    if record.outcome != "finished":
        print(f"{motion.name}: {record.reason}", flush=True)
        return [float("nan")] * 4
    (true,) = simulated_references_of([motion.acceleration], config)
    stories, lower = len(config.specimen.masses), len(config.numerical_substructure.masses)
    noise = noise_streams(config.run.seed)[0].standard_normal((record.steps, stories + 2))
    top = record.floor_accelerations[:, -1] - config.simulated_table.acceleration_noise * noise[:, stories]
    return [
        rmse_percent(true[:, lower - 1], record.desired_acceleration),
        rmse_percent(true[1:, -1], top[:-1]),
        float(np.abs(record.command).max()),
        1e3 * float(np.abs(record.table_displacement).max()),
    ]


@click.command()
@click.option("--building", type=click.Choice(list(BUILDINGS)), default="simplified", show_default=True)
@click.option("--records", type=int, default=len(RECORDS), show_default=True, help="How many of the records.")
@click.option("--duration", default=240.0, show_default=True, help="Of the identification [s].")
@click.option("--options", default=";".join(OPTIONS), show_default=True, help="Compensators.")
def main(building: str, records: int, duration: float, options: str) -> None:
    """Print the table."""
    list_of_records()
    config = base(building).changed(
        run__lockstep=True, virtual_controller__model="servo_hydraulic", shear_estimator__source="load_cell"
    )
    motions = [selected.motion for selected in motions_of(config, records)]
    tables = {"emulator": identified_over_udp(config, duration), "virtual laboratory": identified(config)}
    print("table, compensator | substructure | superstructure, clean; mean (worst) % | command m/s² | table mm")
    for option in options.split(";"):
        for table, known in tables.items():
            chosen = known.changed(**OPTIONS[option])
            rows = np.array([errors(chosen, motion, table == "emulator") for motion in motions])
            mean, worst = rows.mean(axis=0), rows.max(axis=0)
            cells = [f"{mean[i]:.1f} ({worst[i]:.1f})" for i in (0, 1)] + [f"{worst[2]:.1f}", f"{worst[3]:.0f}"]
            print(f"{table}, {option} | {' | '.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
