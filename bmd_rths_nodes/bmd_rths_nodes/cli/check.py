"""``bmd-rths check``: say what was understood of a configuration, before anything moves."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from bmd_rths_nodes.cli.configuration import RECORD_OPTIONS, ConfigChoice, configured
from bmd_rths_nodes.cli.options import json_option, log, progress_bar
from bmd_rths_nodes.cli.results import without_nan

if TYPE_CHECKING:
    from bmd_rths_core.analysis.preflight import Preflight
    from bmd_rths_core.config import Config
    from bmd_rths_core.ground_motion.motion import GroundMotion


#: Width of the table where there is no terminal.
_WIDTH = 160


@click.command(epilog="Example: bmd-rths check config/simplified_bmd.yaml --json")
@configured("scheme", "motion", *RECORD_OPTIONS, "table")
@click.option("--predict/--no-predict", default=True, help="Predict the peaks of the test, by a run in process.")
@json_option
def check(choice: ConfigChoice, predict: bool, as_json: bool) -> int:
    """Say what was understood of a configuration, and warn where numbers look like a slip.

    Tells frequencies, periods, damping and masses of both substructures, their mass ratio, the capacity of the table
    beside the limits, the delay of the table model beside the lead of the compensator, the ground motion as it will be
    run, and the predicted peaks. Status 0 also with warnings; what cannot be run is refused with status 2.
    """
    from bmd_rths_core.analysis.understanding import understanding
    from bmd_rths_core.ground_motion.as_run import ground_motion_as_run

    config = choice.resolve()
    ran = ground_motion_as_run(config.ground_motion, config.run.time_step)
    told = _plain(understanding(config, ran, _predicted(config, ran.motion) if predict else None))
    if as_json:
        click.echo(json.dumps(told))
    else:
        _show(told)
        for warning in told["warnings"]:
            log(f"warning: {warning}")
    return 0


def _predicted(config: Config, motion: GroundMotion) -> Preflight:
    from bmd_rths_core.analysis.preflight import predict_test

    with progress_bar() as progress:
        task = progress.add_task("prediction", total=motion.steps)
        return predict_test(config, motion, lambda done: progress.update(task, completed=done))


def _plain(value: Any) -> Any:
    """Return plain values without NaN."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    return without_nan(value)


def _show(told: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    if not console.is_terminal:  # a pipe keeps long lines
        console = Console(width=_WIDTH)
    table = Table(show_header=False, box=None, pad_edge=False)
    for name in ("numerical_substructure", "specimen"):
        found = told[name]
        title = f"{name.replace('_', ' ')}, {found['floors']} floors"
        table.add_row(title, f"{found['mass_kg']:g} kg ({_listed(found['floor_masses_kg'], 'g')}), {found['given_by']}")
        table.add_row("  frequencies", f"{_listed(found['frequencies_hz'], '.4g')} Hz")
        table.add_row("  periods", f"{_listed(found['periods_s'], '.3g')} s")
        table.add_row("  damping", f"{_listed([100 * ratio for ratio in found['damping_ratios']], '.3g')} %")
    table.add_row("whole building", f"{_listed(told['whole_building_hz'], '.4g')} Hz")
    share = f", {told['mass_ratio_fed_back']:.3f} as fed back" if told["feedback_scale"] != 1.0 else ""
    table.add_row("mass ratio", f"{told['mass_ratio']:.3f}{share}")
    table.add_row("loop", f"{told['rate_hz']:g} Hz, scheme {told['scheme']}, shear from {told['shear']}")
    model = told["table"]
    fit = "" if model["fit_error"] is None else f", fit error {model['fit_error']:.2%} of {model['frequency_response']}"
    table.add_row(
        "table", f"{model['controller']}, model {model['dynamics']}{fit}, platen {model['platen_mass_kg']:g} kg"
    )
    lead = "none by a fixed lead" if model["compensated_ms"] is None else f"{model['compensated_ms']:.1f} ms"
    table.add_row("delay of the model", f"{model['delay_ms']:.1f} ms; compensated: {lead}")
    for row in told["capacity"]:
        capacity = "not told" if row["capacity"] is None else f"{row['capacity']:g} {row['unit']}"
        limits = f"interlock of the emulator {row['interlock']:g}, limit {row['limit']:g} {row['unit']}"
        table.add_row(f"capacity, {row['quantity']}", f"{capacity}; {limits}")
    _add_motion(table, told["ground_motion"])
    if "predicted" in told:
        peaks = told["predicted"]
        table.add_row(
            "predicted peaks",
            f"table {1e3 * peaks['displacement_m']:.3g} mm, {peaks['velocity_m_s']:.3g} m/s; "
            f"command {peaks['command_m_s2']:.3g} m/s²; actuator {1e-3 * peaks['force_n']:.3g} kN",
        )
        table.add_row("stability", peaks["stability"])
    console.print(table, markup=False)


def _add_motion(table: Any, motion: dict[str, Any]) -> None:
    table.add_row(
        "ground motion",
        f"{motion['name']}, {motion['duration_s']:g} s, time scale {motion['time_scale']:g}, "
        f"scale factor {motion['scale_factor']:.4g}",
    )
    for name, heading in (("recorded", "  before scaling"), ("as_run", "  as it will be run")):
        peaks = motion[name]
        table.add_row(
            heading,
            f"PGA {peaks['pga_m_s2']:.4g} m/s², PGV {peaks['pgv_m_s']:.3g} m/s, PGD {1e3 * peaks['pgd_m']:.4g} mm; "
            f"at the end {peaks['last_velocity_m_s']:.2g} m/s, {1e3 * peaks['last_displacement_m']:.3g} mm",
        )
    if "stroke_needed_m" in motion:
        table.add_row("  stroke it needs", f"{1e3 * motion['stroke_needed_m']:.3g} mm of the table")


def _listed(values: list[float], form: str) -> str:
    return ", ".join(format(value, form) for value in values)
