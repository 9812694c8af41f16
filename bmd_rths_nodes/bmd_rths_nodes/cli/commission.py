"""``bmd-rths commission``: the steps before the first powered run, and their protocol."""

from __future__ import annotations

import json
import sys
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.configuration import ConfigChoice, configured
from bmd_rths_nodes.cli.interrupts import collected_interrupts
from bmd_rths_nodes.cli.options import json_option, log

if TYPE_CHECKING:
    from bmd_rths_core.config import Config
    from bmd_rths_core.identification.commissioning import Finding
    from bmd_rths_core.identification.excited_table import Responses

#: What a person has to see with the own eyes.
_QUESTION = "Press the emergency stop of the laboratory: does the table lose its power, and stand still?"


def protocol_path(config: str) -> Path:
    """Return where the protocol of a configuration file is.

    Parameters
    ----------
    config : str
        CONFIG of the command line.
    """
    path = Path(config)
    return path.with_name(f"{path.stem}.commissioning.json")


def age_in_words(config: str) -> str:
    """Return how old the protocol of a configuration is, in words; that there is none, or that it has failed.

    Parameters
    ----------
    config : str
        CONFIG of the command line.
    """
    path = protocol_path(config)
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        days = (datetime.now(timezone.utc) - datetime.fromisoformat(told["date"])).days
        outcome = "passed" if told["passed"] else "NOT passed"
    except (OSError, ValueError, KeyError, TypeError):
        return f"commissioning: no protocol {path}; bmd-rths commission writes one"
    return f"commissioning: {outcome} {days} days ago ({path})"


@click.command(epilog="Example: bmd-rths commission my_rig.yaml --table udp://192.168.0.20:50600")
@configured("table")
@click.option("--stop-confirmed", is_flag=True, help="The emergency stop of the laboratory was tried, and works.")
@click.option("--try-stop", is_flag=True, help="Ask the table controller for its emergency stop, at rest.")
@click.option(
    "--zero", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE.yaml", help="Write the zeros for --model."
)
@json_option
def commission(choice: ConfigChoice, stop_confirmed: bool, try_stop: bool, zero: Path | None, as_json: bool) -> int:
    """Walk through what has to be right before the first powered run, and write a protocol beside CONFIG.

    The table is held at rest for noise floor and zero, then moved by three slow pulses to a tenth of its displacement
    limit: polarity of every sensor, scale against the displacement of the table. Each limit is passed once on the
    simulated table. At the end the emergency stop has to be confirmed by a person. Status 1 when anything is not as it
    should be. With --zero the readings at rest become the offsets of all sensors, for the next call and for `run`.
    """
    from bmd_rths_core.identification.commissioning import emergency_stop, zero_file
    from bmd_rths_core.identification.excited_table import DrivingStopped
    from bmd_rths_nodes.hardware.controllers import make_patient_table_controller

    config = choice.resolve()
    try:
        responses = _driven(config)
    except DrivingStopped as error:
        log(f"error: {error}")
        return 1
    if zero is not None:
        _write(zero, zero_file(responses, config))
    findings = _findings(responses, config)
    if try_stop:
        findings.append(emergency_stop(make_patient_table_controller(config)))
    findings.append(_confirmed(stop_confirmed))
    told = _protocol(config, findings)
    path = protocol_path(choice.config)
    _write(path, json.dumps(told, indent=1) + "\n")
    if as_json:
        click.echo(json.dumps({**told, "protocol": str(path)}))
    else:
        for finding in findings:
            click.echo(f"{'ok    ' if finding.passed else 'FAILED'} {finding.step}: {finding.told}")
        click.echo(str(path))
    return 0 if told["passed"] else 1


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def _driven(config: Config) -> Responses:
    from bmd_rths_core.identification.commissioning import pulse_commands
    from bmd_rths_core.identification.excited_table import drive
    from bmd_rths_core.loop.build import make_calibration, make_supervisor
    from bmd_rths_nodes.hardware.clock import MonotonicClock
    from bmd_rths_nodes.hardware.controllers import make_patient_table_controller
    from bmd_rths_nodes.hardware.time_slice import shorten_time_slices

    shorten_time_slices(config.real_time.time_slice)
    by_steps = config.run.lockstep or config.table.controller == "simulated"
    commands = pulse_commands(config)
    log(f"three slow pulses of {len(commands) * config.run.time_step:.0f} s in all (Ctrl-C stops them)")
    with collected_interrupts() as interrupts:
        return drive(
            make_patient_table_controller(config),
            make_supervisor(config),
            commands,
            config.run.time_step,
            clock=None if by_steps else MonotonicClock(),
            stops_asked=lambda: len(interrupts),
            calibration=make_calibration(config),
        )


def _findings(responses: Responses, config: Config) -> list[Finding]:
    from bmd_rths_core.identification.commissioning import LIMITS, at_rest, polarity_and_scale, try_limit

    limits = [try_limit(config, limit) for limit in LIMITS]
    return [*at_rest(responses, config), *polarity_and_scale(responses, config), *limits]


def _confirmed(told: bool) -> Finding:
    from bmd_rths_core.identification.commissioning import Finding

    if not told and sys.stdin.isatty():
        told = click.confirm(_QUESTION, err=True)
    words = "confirmed by a person" if told else "not confirmed; --stop-confirmed, or yes on a terminal, is required"
    return Finding("emergency stop", told, words)


def _protocol(config: Config, findings: list[Finding]) -> dict[str, Any]:
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "passed": all(finding.passed for finding in findings),
        "table": config.table.controller,
        "sensors": config.as_mapping()["sensors"],
        "steps": [vars(finding) for finding in findings],
    }
