"""``bmd-rths identify``: find models of table and specimen, by moving the table or from a bag."""

from __future__ import annotations

import gc
import json
import math
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource
from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.table import Table

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.configuration import ConfigChoice, configured
from bmd_rths_nodes.cli.interrupts import collected_interrupts
from bmd_rths_nodes.cli.options import json_option, log, progress_bar

if TYPE_CHECKING:
    from bmd_rths_core.config import Config
    from bmd_rths_core.identification.excitation import ExcitationSettings
    from bmd_rths_core.identification.excited_table import Responses
    from bmd_rths_core.identification.joint_model import JointModel
    from bmd_rths_core.identification.specimen_model import SpecimenModel
    from bmd_rths_core.identification.table_model import TableModel

#: Largest command without --amplitude [m/s²]. A sweep dwells at each resonance of the specimen, so it has less.
_AMPLITUDES = {"noise": 2.0, "sweep": 0.4}

#: Allowed displacement without --stroke where rig.stroke is not told [m].
_STROKE = 0.25

_FILE = click.Path(dir_okay=False, path_type=Path)


@click.command(epilog="Example: bmd-rths identify config/simplified_bmd.yaml --output model.yaml --frf measured.csv")
@configured("table")
@click.option("--what", type=click.Choice(("table", "specimen", "both")), default="both", help="What to identify.")
@click.option("--bag", metavar="BAG", help="Take a recorded test instead of moving the table.")
@click.option("--excitation", type=click.Choice(tuple(_AMPLITUDES)), default="noise", help="How the table is moved.")
@click.option("--band", nargs=2, type=float, default=(0.5, 25.0), metavar="LOW HIGH", help="Band in Hz [0.5 25].")
@click.option("--delay-band", nargs=2, type=float, default=(0.5, 8.0), metavar="LOW HIGH", help="Of alpha, Hz [0.5 8].")
@click.option(
    "--amplitude", type=float, metavar="M_S2", help="Largest command in m/s2 [noise 2, sweep 0.4, or the limit]."
)
@click.option("--duration", type=float, default=240.0, metavar="S", help="Duration of the excitation in s [240].")
@click.option("--stroke", type=float, metavar="M", help="Allowed displacement in m [the limit, or 0.25].")
@click.option("--order", default="auto", metavar="N|auto", help="Order of the table model.")
@click.option("--seed", type=int, help="Seed of the noise, and of the simulated sensors [run.seed].")
@click.option("--output", type=_FILE, metavar="FILE.yaml", help="Write the models as parameters for --model.")
@click.option("--frf", type=_FILE, metavar="FILE.csv", help="Write the measured frequency response of the table.")
@json_option
def identify(
    choice: ConfigChoice,
    what: str,
    bag: str | None,
    excitation: str,
    band: tuple[float, float],
    delay_band: tuple[float, float],
    amplitude: float | None,
    duration: float,
    stroke: float | None,
    order: str,
    seed: int | None,
    output: Path | None,
    frf: Path | None,
    as_json: bool,
) -> int:
    """Identify the table, its delay and the specimen on it.

    Moves the table with noise or a sweep of limited acceleration, from rest to rest, and fits models to the measured
    accelerations; where both are identified, they are fitted together too, which is the model that compensators know.
    Begin with a small amplitude: a resonance multiplies it. With --bag nothing moves.
    """
    from bmd_rths_core.identification.excitation import ExcitationSettings
    from bmd_rths_core.identification.excited_table import DrivingStopped, responses_of
    from bmd_rths_msgs_py.bag_reader import read_bag

    if bag is not None:
        _refuse_excitation()
    resolved = choice.resolve(**({} if seed is None else {"run__seed": seed}))
    fixed_order = _order(order)
    if frf is not None and what == "specimen":
        raise InputError("--frf: the frequency response of the table is asked for, but --what is specimen")
    for option, file in (("--output", output), ("--frf", frf)):
        if file is not None and not file.absolute().parent.is_dir():
            raise InputError(f"{option} {file}: cannot be written: there is no such folder")
    excited = ExcitationSettings(
        kind=excitation,
        band=_radians(band),
        amplitude=_allowed_amplitude(resolved, excitation, amplitude),
        duration=duration,
        seed=resolved.run.seed,
        stroke=_allowed_stroke(resolved, stroke),
    )
    try:
        responses = responses_of(read_bag(bag)) if bag is not None else _drive(resolved, excited)
    except DrivingStopped as error:
        log(f"error: {error}")
        return 1
    table, specimen, joint = _identified(responses, resolved, what, _radians(band), _radians(delay_band), fixed_order)
    result: dict[str, Any] = {"what": what, "source": responses.source if bag is not None else _words(excited)}
    if bag is None and responses.source != "driven":
        result["source"] += f" ({responses.source.removeprefix('driven; ')})"
    result |= {"time_step": responses.time_step, "band_hz": list(band)}
    result["largest_acceleration"] = {"table": responses.largest_table, "floors": responses.largest_floor}
    if table is not None:
        result |= table.summary()
        result["delay"]["band_hz"] = list(delay_band)
    if specimen is not None:
        result["specimen"] = specimen.summary()
    if joint is not None:
        result["identified_model"] = joint.summary()
    result["files"] = _write(output, frf, (table, specimen, joint), result)
    _show(result, as_json)
    return 0


def _allowed_amplitude(config: Config, excitation: str, asked: float | None) -> float:
    """Return the largest command [m/s²]; one that the table cannot follow is refused."""
    capacity = config.rig.acceleration
    if asked is None:
        usual = _AMPLITUDES[excitation]
        return min(usual, config.safety.acceleration_limit) if capacity else usual
    if capacity and asked > capacity:
        raise InputError(f"--amplitude {asked:g}: <= {capacity:g} m/s2, rig.acceleration, is required")
    return asked


def _allowed_stroke(config: Config, asked: float | None) -> float:
    """Return the allowed displacement [m]; one that the table does not have is refused."""
    capacity = config.rig.stroke
    if asked is None:
        return config.safety.displacement_limit if capacity else _STROKE
    if capacity and asked > capacity:
        raise InputError(f"--stroke {asked:g}: <= {capacity:g} m, rig.stroke, is required")
    return asked


def _refuse_excitation() -> None:
    """Refuse options of the excitation together with ``--bag``, which moves nothing."""
    context = click.get_current_context()
    for name in ("excitation", "amplitude", "duration", "stroke", "seed", "table"):
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise InputError(f"--{name}, --bag: not together; the motion is that of the bag")


def _drive(config: Config, excited: ExcitationSettings) -> Responses:
    from bmd_rths_core.identification.excitation import excitation_command
    from bmd_rths_core.identification.excited_table import drive
    from bmd_rths_core.loop.build import make_calibration, make_supervisor
    from bmd_rths_core.safety import Action
    from bmd_rths_core.table.config import LONGEST_ANSWER_TIMEOUT
    from bmd_rths_nodes.hardware.clock import MonotonicClock
    from bmd_rths_nodes.hardware.controllers import make_patient_table_controller
    from bmd_rths_nodes.hardware.time_slice import shorten_time_slices

    shorten_time_slices(config.real_time.time_slice)
    commands = excitation_command(excited, config.run.time_step)
    # A ramp does not hurt the specimen, and a controller whose answers are lost may hear the commands all the same.
    supervisor = make_supervisor(config.changed(safety__stale_controller_action=Action.RAMP.name.lower()))
    # Late answers are data as good as any: no loop waits for them.
    patience = max(config.table.answer_timeout, min(config.safety.stale_controller_time, LONGEST_ANSWER_TIMEOUT))
    table = make_patient_table_controller(config.changed(table__answer_timeout=patience))
    with collected_interrupts() as interrupts:
        if _by_steps(config):
            columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} steps"))
            with progress_bar(*columns) as progress:
                task = progress.add_task(_words(excited), total=len(commands))
                return drive(
                    table,
                    supervisor,
                    commands,
                    config.run.time_step,
                    progress=lambda done: progress.update(task, completed=done),
                    stops_asked=lambda: len(interrupts),
                    calibration=make_calibration(config),
                )
        # Nothing else happens in this process while the table moves: no drawing, no collection of garbage.
        log(f"{_words(excited)}: the table moves for {len(commands) * config.run.time_step:.0f} s (Ctrl-C stops it)")
        gc.collect()
        gc.freeze()
        responses = drive(
            table,
            supervisor,
            commands,
            config.run.time_step,
            clock=MonotonicClock(),
            stops_asked=lambda: len(interrupts),
            calibration=make_calibration(config),
        )
    if responses.source != "driven":
        log(responses.source)
    return responses


def _by_steps(config: Config) -> bool:
    """Tell whether the table of a configuration is computed step by step, as fast as it goes."""
    return config.run.lockstep or config.table.controller == "simulated"


def _identified(
    responses: Responses,
    config: Config,
    what: str,
    band: tuple[float, float],
    delay_band: tuple[float, float],
    order: int | None,
) -> tuple[TableModel | None, SpecimenModel | None, JointModel | None]:
    from bmd_rths_core.identification.joint_model import identify_joint
    from bmd_rths_core.identification.specimen_model import identify_specimen
    from bmd_rths_core.identification.table_model import identify_table

    table = specimen = joint = None
    with progress_bar(TextColumn("{task.description}"), BarColumn()) as progress:
        if what != "specimen":
            task = progress.add_task("fitting the table", total=None)
            table = identify_table(responses, band, delay_band, order)
            progress.remove_task(task)
        if what != "table":
            task = progress.add_task("fitting the specimen", total=None)
            specimen = identify_specimen(responses, config.specimen.masses, band)
            progress.remove_task(task)
        if table is not None and specimen is not None:
            progress.add_task("fitting both together", total=None)
            joint = identify_joint(responses, table, specimen, band)
    return table, specimen, joint


def _write(
    output: Path | None,
    frf: Path | None,
    models: tuple[TableModel | None, SpecimenModel | None, JointModel | None],
    result: dict[str, Any],
) -> dict[str, str]:
    """Write model and frequency response where they were asked for, and return the files."""
    from bmd_rths_core.identification.output import frequency_response_text, model_text

    files = {}
    try:
        if output is not None:
            parameters: dict[str, dict[str, Any]] = {}
            for model in models:
                for name, values in model.parameters().items() if model is not None else ():
                    parameters.setdefault(name, {}).update(values)
            output.write_text(model_text(parameters, _remarks(result)), encoding="utf-8")
            files["output"] = str(output)
        table = models[0]
        if frf is not None and table is not None:
            frf.write_text(frequency_response_text(table.measured), encoding="utf-8")
            files["frf"] = str(frf)
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written: {error.strerror}") from error
    return files


def _remarks(result: dict[str, Any]) -> list[str]:
    """Return the remarks at the head of a model file: how it was found."""
    now = datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    lowest, highest = result["band_hz"]
    remarks = [
        f"Identified by bmd-rths identify on {now}, for --model FILE or another --params-file of ROS.",
        f"Source: {result['source']}. Band of the fit: {lowest:g} to {highest:g} Hz.",
    ]
    if "order" in result:
        delay = result["delay"]
        remarks.append(
            f"Table: order {result['order']}, fit error {result['fit_error_percent']:.2f} %, "
            f"delay {delay['ms']:.2f} ms from {delay['band_hz'][0]:g} to {delay['band_hz'][1]:g} Hz, "
            f"coherence {_coherence(result['coherence'])}."
        )
    if "specimen" in result:
        remarks.append(f"Specimen: the masses were given; coherence {_coherence(result['specimen']['coherence'])}.")
    if "identified_model" in result:
        together = result["identified_model"]
        remarks.append(f"Both together: {_structure(together)}, fit error {together['fit_error_percent']:.2f} %.")
    return remarks


def _structure(together: dict[str, Any]) -> str:
    return {
        "interacting_servo": "a servo that the specimen pulls at",
        "hydraulic_servo": "a servo with oil column and servovalve that the specimen pulls at",
        "sections": "a table of sections",
    }[together["table"]]


def _show(result: dict[str, Any], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(result))
        return
    table = Table(title=result["source"], title_justify="left", show_header=False, title_style="bold")
    if "order" in result:
        delay = result["delay"]
        spread = f"{delay['smallest_ms']:.1f} to {delay['largest_ms']:.1f} ms"
        table.add_row("table: order, zeros", f"{result['order']}, {result['numerator_degree']}")
        table.add_row("fit error; residual over noise", _fit(result))
        table.add_row("pure delay in the model", f"{result['command_delay_ms']:.2f} ms")
        table.add_row("delay alpha", f"{delay['steps']:.3f} steps, {delay['ms']:.2f} ms ({spread})")
        table.add_row("coherence, table", _coherence(result["coherence"]))
    if "specimen" in result:
        found = result["specimen"]
        for i, frequency in enumerate(found["frequencies_hz"]):
            table.add_row(f"mode {i + 1}", f"{frequency:.3f} Hz, {100 * found['damping_ratios'][i]:.2f} %")
        for i in range(len(found["masses"])):
            stiffness = f"{found['stiffnesses'][i]:.0f} ± {found['stiffness_deviations'][i]:.0f} N/m"
            damping = f"{found['damping_coefficients'][i]:.0f} ± {found['damping_deviations'][i]:.0f} N s/m"
            table.add_row(f"story {i + 1}, {found['masses'][i]:g} kg", f"{stiffness}, {damping}")
        table.add_row("coherence, specimen", _coherence(found["coherence"]))
    if "identified_model" in result:
        _show_together(table, result["identified_model"])
    largest = result["largest_acceleration"]
    table.add_row("largest acceleration", f"table {largest['table']:.2f}, floors {largest['floors']:.2f} m/s2")
    Console(soft_wrap=True).print(table)
    for file in result["files"].values():
        click.echo(file)


def _show_together(table: Table, found: dict[str, Any]) -> None:
    table.add_row("both together", f"{_structure(found)}, fit error {found['fit_error_percent']:.2f} %")
    for name, value in found["servo"].items():
        table.add_row(name.replace("_", " "), f"{value:.4g} ± {found['servo_deviations'][name]:.2g}")
    for i, stiffness in enumerate(found["stiffnesses"]):
        spread = f"{stiffness:.0f} ± {found['stiffness_deviations'][i]:.0f} N/m"
        damping = f"{found['damping_coefficients'][i]:.0f} ± {found['damping_deviations'][i]:.0f} N s/m"
        table.add_row(f"story {i + 1}, together", f"{spread}, {damping}")
    units = {"acceleration_noise": (1.0, "m/s2"), "displacement_noise": (1e3, "mm"), "shear_noise": (1.0, "N")}
    noise = ", ".join(
        f"{name.removesuffix('_noise')} {units[name][0] * value:.3g} {units[name][1]}"
        for name, value in found["noise"].items()
    )
    table.add_row("noise of the sensors", noise)


def _fit(result: dict[str, Any]) -> str:
    return f"{result['fit_error_percent']:.2f} %; {result['residual_over_noise']:.2f}"


def _coherence(summary: dict[str, Any]) -> str:
    text = f"{summary['smallest']:.3f} and more, median {summary['median']:.3f}"
    bands = [f"{lowest:.2f}-{highest:.2f}" for lowest, highest in summary["incoherent_bands_hz"]]
    if bands:
        from bmd_rths_core.identification.spectral_lines import LEAST_COHERENCE

        text += f"; below {LEAST_COHERENCE:g} and not used: {', '.join(bands)} Hz"
    return text


def _words(excited: ExcitationSettings) -> str:
    seed = f", seed {excited.seed}" if excited.kind == "noise" else ""
    return f"{excited.kind} of {excited.amplitude:g} m/s2 for {excited.duration:g} s{seed}"


def _order(text: str) -> int | None:
    if text == "auto":
        return None
    from bmd_rths_core.identification.table_model import LARGEST_ORDER

    if not text.isdigit() or not 1 <= int(text) <= LARGEST_ORDER:
        raise InputError(f"--order {text}: auto or a whole number from 1 to {LARGEST_ORDER} is required")
    return int(text)


def _radians(band: tuple[float, float]) -> tuple[float, float]:
    return (2.0 * math.pi * band[0], 2.0 * math.pi * band[1])
