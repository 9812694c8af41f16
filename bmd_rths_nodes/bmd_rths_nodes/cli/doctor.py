"""``bmd-rths doctor``: say whether this computer can run a test in real time, and what to change."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.progress import TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from bmd_rths_nodes.cli.configuration import ConfigChoice, configured
from bmd_rths_nodes.cli.options import json_option, progress_bar

if TYPE_CHECKING:
    from bmd_rths_nodes.doctor.finding import Finding

_MARKS = {"good": ("✓", "green"), "note": ("·", ""), "warning": ("!", "yellow"), "problem": ("✗", "red")}


@click.command(epilog="Example: bmd-rths doctor config/simplified_bmd.yaml")
@configured(default="simplified_bmd")
@click.option("--quick", is_flag=True, help="Look only; measure no timer and run no test.")
@click.option("--duration", type=click.FloatRange(1.0, 600.0), default=10.0, show_default=True, help="Of the test [s].")
@click.option("--output", type=click.Path(path_type=Path), default=Path("bags"), help="Folder the bags go into.")
@json_option
def doctor(choice: ConfigChoice, quick: bool, duration: float, output: Path, as_json: bool) -> int:
    """Say which rate this computer holds, with how many misses, and what to change.

    Looks at Python, ROS, middleware, domain, memory, buffers, processors, clock, disk and ports; measures how late a
    timer wakes up; and runs a real test of ten seconds with composed nodes and the simulated table of CONFIG. No table
    is connected. Status 1 when there is a problem.
    """
    from bmd_rths_nodes.doctor import measured
    from bmd_rths_nodes.doctor.finding import PROBLEM, change_first, worst
    from bmd_rths_nodes.doctor.integration import integration_finding
    from bmd_rths_nodes.doctor.machine import Machine

    config = choice.resolve()
    with progress_bar(TextColumn("{task.description}"), TimeElapsedColumn()) as progress:
        task = progress.add_task("looking", total=None)
        findings = [*Machine().findings(), measured.disk(output), measured.table_port()]
        words = ""
        if not quick:
            progress.update(task, description="measuring the timer")
            jitter = measured.timer(config.run.time_step)
            findings.append(measured.jitter_finding(jitter, config.run.time_step))
            if config.compensator.control is None:
                findings.append(integration_finding(config))
            if importlib.util.find_spec("rclpy") is not None:
                findings.append(measured.others_finding(_other_nodes()))
                progress.update(task, description=f"running a test of {duration:g} s")
                run = measured.run_loop(config, duration)
                findings.append(measured.loop_finding(run))
                words = measured.verdict(run, jitter)
    level, change = worst(findings), change_first(findings)
    if as_json:
        told = {"level": level, "verdict": words or None, "change_first": change or None}
        click.echo(json.dumps({**told, "checks": [finding.as_mapping() for finding in findings]}))
    else:
        _show(findings, f"{words}\nChange first: {change}".strip() if change else words)
    return 1 if level == PROBLEM else 0


def _other_nodes() -> list[str]:
    from bmd_rths_nodes.run.monitor import DISCOVERY_TIME, RunMonitor

    with RunMonitor() as monitor:
        monitor.update(DISCOVERY_TIME)
        return monitor.all_nodes()


def _show(findings: list[Finding], words: str) -> None:
    table = Table(show_header=False, box=None, padding=(0, 1))
    for finding in findings:
        mark, style = _MARKS[finding.level]
        found = Text(finding.found, style)
        if finding.advice:
            found.append(f"\n→ {finding.advice}", "dim")
        table.add_row(Text(mark, style), finding.name, found)
    console = Console()
    console.print(table)
    if words:
        console.print(Text(words, "bold"))
