"""``bmd-rths new-rig``: write the configuration of a rig of one's own, from options or questions."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import click

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.options import log

#: What has to be told, and how it is asked for.
_QUESTIONS = {
    "specimen_masses": "Floor masses of the specimen from the table up [kg], with commas",
    "specimen_stiffnesses": "Story stiffnesses of the specimen from the table up [N/m]",
    "numerical_masses": "Floor masses of the numerical substructure from the ground up [kg]",
    "numerical_stiffnesses": "Story stiffnesses of the numerical substructure from the ground up [N/m]",
    "stroke": "Stroke of the table to either side [m]",
    "velocity": "Largest velocity of the table [m/s]",
    "acceleration": "Largest acceleration of the table with the specimen [m/s2]",
    "force": "Largest force of the actuator [N]",
}


class _Numbers(click.ParamType):
    """Numbers with commas between."""

    name = "numbers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the numbers as a tuple."""
        if isinstance(value, tuple):
            return value
        try:
            return tuple(float(cell) for cell in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers with commas between, as 1000,800", param, ctx)


_NUMBERS = _Numbers()
_FILE = click.Path(dir_okay=False)


@click.command(
    "new-rig",
    epilog="Example: bmd-rths new-rig my_rig.yaml --stroke 0.1 --velocity 0.5 --acceleration 10 --force 1e5 "
    "--specimen-masses 1000,1000 --specimen-stiffnesses 1.5e6,1.2e6 "
    "--numerical-masses 20000,20000,20000 --numerical-stiffnesses 5e7,5e7,4e7",
)
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--name", default="A rig of our own", help="What stands in the first line.")
@click.option("--specimen-masses", type=_NUMBERS, metavar="KG,…", help="From the table up.")
@click.option("--specimen-stiffnesses", type=_NUMBERS, metavar="N/M,…", help="From the table up.")
@click.option("--specimen-damping", type=_NUMBERS, metavar="RATIO,…", help="Of all modes, or of each [0.02].")
@click.option("--specimen-matrices", type=_FILE, metavar="FILE", help="M, K and C in place of stories: CSV, NPZ, MAT.")
@click.option("--numerical-masses", type=_NUMBERS, metavar="KG,…", help="From the ground up.")
@click.option("--numerical-stiffnesses", type=_NUMBERS, metavar="N/M,…", help="From the ground up.")
@click.option("--numerical-damping", type=_NUMBERS, metavar="RATIO,…", help="Of all modes, or of each [0.02].")
@click.option("--numerical-matrices", type=_FILE, metavar="FILE", help="M, K and C in place of stories.")
@click.option("--stroke", type=float, metavar="M", help="Of the table, to either side.")
@click.option("--velocity", type=float, metavar="M_S", help="Largest of the table.")
@click.option("--acceleration", type=float, metavar="M_S2", help="Largest of the table, with the specimen on it.")
@click.option("--force", type=float, metavar="N", help="Largest of the actuator.")
@click.option("--platen-mass", type=float, default=0.0, metavar="KG", help="Platen and piston [10 kg for each kN].")
@click.option("--table-frf", type=_FILE, metavar="FILE.csv", help="Measured frequency response of the table.")
@click.option("--rate", type=float, default=200.0, metavar="HZ", help="Steps a second [200].")
@click.option("--motion", default="el_centro_1940_ns", help="Record, or the name of a shipped one.")
@click.option("--peak-acceleration", type=float, default=0.0, metavar="M_S2", help="Scale it to this peak [as it is].")
@click.option("--time-scale", type=float, default=1.0, help="Factor on its time axis [1].")
@click.option("--scheme", default="plc_fc", help="Compensator [plc_fc].")
@click.option("--shear", type=click.Choice(("load_cell", "kalman")), default="kalman", help="Source of the shear.")
@click.option("--feedback-scale", type=float, default=1.0, help="Share of the shear that is fed back [1].")
@click.option("--ask", is_flag=True, help="Ask for what is not given. [default: on a terminal]")
@click.option("--force-write", "overwrite", is_flag=True, help="Write over a file that exists.")
def new_rig(file: Path, ask: bool, overwrite: bool, **told: Any) -> int:
    """Write the configuration of a rig of one's own, with comments, from options or questions.

    What is written has been read again, with its table fitted and its lead set to the delay of the table; bmd-rths
    check says what was understood of it.
    """
    if file.exists() and not overwrite:
        raise InputError(f"{file}: exists; --force-write writes over it")
    if not file.absolute().parent.is_dir():
        raise InputError(f"{file}: cannot be written: there is no such folder")
    _complete(told, ask or sys.stdin.isatty())
    text = _text(file, told)
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror}") from error
    click.echo(str(file))
    log(f"next: bmd-rths check {file}")
    return 0


def _complete(told: dict[str, Any], ask: bool) -> None:
    """Ask for what is missing, or refuse."""
    for key, question in _QUESTIONS.items():
        part = key.partition("_")[0]
        if told[key] is not None or told.get(f"{part}_matrices"):
            continue
        if not ask:
            raise InputError(f"--{key.replace('_', '-')}: not given; {question} is required")
        kind = _NUMBERS if key.endswith(("masses", "stiffnesses")) else float
        told[key] = click.prompt(question, type=kind, err=True)


def _text(file: Path, told: dict[str, Any]) -> str:
    """Return the configuration; it has been read again, and its lead is the delay of its table."""
    import dataclasses
    import tempfile

    from bmd_rths_core.analysis.understanding import table_delay
    from bmd_rths_core.compensators.schemes import PHASE_LEAD
    from bmd_rths_core.config import load_config
    from bmd_rths_core.ground_motion.config import select_ground_motion
    from bmd_rths_core.new_rig import Rig, rig_text
    from bmd_rths_nodes.cli.configuration import fitted

    folder = file.absolute().parent
    rig = Rig(
        name=" ".join(told["name"].split()),
        numerical=_structure(told, "numerical", folder),
        specimen=_structure(told, "specimen", folder),
        stroke=told["stroke"],
        velocity=told["velocity"],
        acceleration=told["acceleration"],
        force=told["force"],
        platen_mass=told["platen_mass"],
        frequency_response=_beside(told["table_frf"], folder),
        rate=told["rate"],
        motion=_record(told["motion"]),
        peak_acceleration=told["peak_acceleration"],
        time_scale=told["time_scale"],
        scheme=told["scheme"],
        load_cells=told["shear"] == "load_cell",
        feedback_scale=told["feedback_scale"],
    )
    # Read beside the file that will be written, so that its relative paths mean the same.
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", dir=folder, encoding="utf-8") as trial:
        trial.write(rig_text(rig))
        trial.flush()
        try:
            config = fitted(load_config(trial.name))
        except InputError as error:
            raise InputError(str(error).removeprefix(f"{trial.name}: ")) from error
    select_ground_motion(config.ground_motion, config.run.time_step)
    if rig.scheme in PHASE_LEAD:
        rig = dataclasses.replace(rig, lead_time=max(0.0, round(table_delay(config), 4)))
    return rig_text(rig)


def _structure(told: dict[str, Any], name: str, folder: Path) -> Any:
    from bmd_rths_core.new_rig import Structure
    from bmd_rths_core.structure.matrix_file import read_matrices

    file, ratios = told[f"{name}_matrices"], told[f"{name}_damping"]
    if file is None:
        return Structure(told[f"{name}_masses"], told[f"{name}_stiffnesses"], ratios or (0.02,))
    if told[f"{name}_masses"] is not None or told[f"{name}_stiffnesses"] is not None:
        raise InputError(f"--{name}-matrices, --{name}-masses: not together; stories or matrices are required")
    default = () if "C" in read_matrices(file) else (0.02,)
    return Structure(damping_ratios=ratios or default, matrices=_beside(file, folder))


def _beside(path: str | None, folder: Path) -> str:
    """Return a path as it is told in a file of a folder."""
    return "" if path is None else os.path.relpath(path, folder)


def _record(motion: str) -> str:
    from bmd_rths_core.ground_motion.library import shipped_records

    return motion if motion in shipped_records() else os.path.abspath(motion)
