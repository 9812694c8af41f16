"""``bmd-rths replay``: compute the shear and its correction again from a bag."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.topics import FORCE_CORRECTION, SHEAR_ESTIMATOR
from bmd_rths_nodes.cli.configuration import model_option, parsed_settings, set_option
from bmd_rths_nodes.cli.interrupts import collected_interrupts
from bmd_rths_nodes.cli.options import check_writable, json_option, log, namespace_option, progress_bar
from bmd_rths_nodes.cli.results import without_nan
from bmd_rths_nodes.cli.ros_required import require_ros
from bmd_rths_nodes.run.bag_names import new_bag_directory

if TYPE_CHECKING:
    from bmd_rths_core.analysis.replay import Replay, SignalDifference
    from bmd_rths_core.config import Config
    from bmd_rths_core.record import RunRecord


@click.command(epilog="Example: bmd-rths replay bags/el_centro_plc_fc_20260801_101500 --set force_correction.gain=0.3")
@click.argument("bag")
@model_option
@set_option
@click.option("--ros", is_flag=True, help="Play to the nodes on this ROS domain, and compare what they answer.")
@click.option(
    "--rate",
    type=click.FloatRange(min=0.0, min_open=True),
    help="With --ros: how much faster than recorded. [default: 1]",
)
@click.option(
    "--wait-for",
    "peers",
    metavar="NODES",
    help=f"With --ros: nodes that have to be ready first. [default: {SHEAR_ESTIMATOR},{FORCE_CORRECTION}]",
)
@click.option("--output", type=click.Path(path_type=Path), help="Folder to write a bag of the replay into.")
@namespace_option
@json_option
def replay(
    bag: str,
    models: tuple[str, ...],
    settings: tuple[str, ...],
    ros: bool,
    rate: float | None,
    peers: str | None,
    output: Path | None,
    namespace: str,
    as_json: bool,
) -> int:
    """Feed recorded measurements through shear estimator and force correction again, and show the difference.

    With the parameters of the recording the outputs are those of the recording bit for bit; the exit status is 1 when
    they are not. With --ros the measurements, required forces and everything before them are published, each step at
    its time, when the nodes that are to answer are ready. Their parameters are their own.
    """
    if ros and (models or settings):
        raise InputError("--ros, --set, --model: not together; the nodes that answer have parameters of their own")
    if not ros and (rate is not None or peers is not None):
        raise InputError("--rate, --wait-for: only possible with --ros")
    if ros:
        require_ros("replay --ros")
    from bmd_rths_core.analysis.replay import changed_parameters
    from bmd_rths_core.analysis.replay import replay as replay_in_process
    from bmd_rths_core.config import config_from_mapping
    from bmd_rths_msgs_py.bag_reader import read_bag

    record = read_bag(bag)
    if record.outcome == "cut":
        log(f"warning: {bag}: {record.reason}")
    if output is not None:
        check_writable(output)
    if ros:
        names = f"{SHEAR_ESTIMATOR},{FORCE_CORRECTION}" if peers is None else peers
        return _on_ros(record, rate or 1.0, [name for name in names.split(",") if name], namespace, output, as_json)
    recorded = config_from_mapping(record.configuration)
    config = _changed(recorded, models, settings)
    done = replay_in_process(record, config)
    changed, idle = changed_parameters(recorded, config)
    if idle:
        log(f"warning: without effect in a replay: {', '.join(idle)}")
    result = {"changed": {name: list(values) for name, values in changed.items()}, **_result_of(done)}
    _finish(done, result, output, as_json)
    if changed or result["reproduced"] is not False:
        return 0
    log(f"error: {bag}: not reproduced; {_libraries(done)}")
    return 1


def _changed(config: Config, models: tuple[str, ...], settings: tuple[str, ...]) -> Config:
    for model in models:
        config = config.merged(model)
    return config.changed(**parsed_settings(settings))


def _on_ros(
    record: RunRecord, rate: float, peers: list[str], namespace: str, output: Path | None, as_json: bool
) -> int:
    """Play to the nodes and compare their answers; return 1 when that ended early."""
    from bmd_rths_core.analysis.replay import answered_replay
    from bmd_rths_core.config import config_from_mapping
    from bmd_rths_nodes.ros.playback import NotReady, Playback
    from bmd_rths_nodes.run.domain_lock import domain_lock
    from bmd_rths_nodes.run.monitor import RunMonitor

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} steps"))
    with (
        collected_interrupts() as interrupts,
        domain_lock(namespace),
        RunMonitor(namespace) as monitor,
        contextlib.closing(Playback(monitor, record, config_from_mapping(record.configuration))) as playback,
        progress_bar(*columns, TimeElapsedColumn()) as progress,
    ):
        task = progress.add_task(f"waiting for {', '.join(peers)}", total=record.steps)
        log(f"waiting until {', '.join(peers)} are ready (Ctrl-C ends)")
        try:
            playback.wait_for(peers, interrupts)
        except NotReady as error:
            log(f"error: {error}; without a recorder they need run.record:=false")
            return 1
        progress.update(task, description=record.motion["name"])
        if not interrupts:
            log(f"playing {record.steps} steps, {record.steps * record.time_step / rate:.3g} s")
        playback.play(rate, interrupts, lambda steps: progress.update(task, completed=steps))
    if interrupts:
        log("stopped")
    if not interrupts or any(playback.answers.values()):
        done = answered_replay(record, playback.answers)
        result = {"rate": rate, "late_steps": playback.late_steps, **_result_of(done)}
        _finish(done, result, output, as_json)
    return 1 if interrupts else 0


def _result_of(done: Replay) -> dict[str, Any]:
    """Return the result as plain values; `reproduced` is None where no step can be compared."""
    record, differences = done.recorded, done.differences()
    equal = all(difference.differing == 0 for difference in differences.values())
    compared = any(difference.compared for difference in differences.values())
    return {
        "bag": record.source,
        "motion": record.motion["name"],
        "scheme": record.configuration["run"]["scheme"],
        "steps": record.steps,
        "reproduced": equal if compared else None,
        "signals": {
            name: {**without_nan(vars(difference)), "unknown_steps": done.unknown_steps(name)}
            for name, difference in differences.items()
        },
    }


def _finish(done: Replay, result: dict[str, Any], output: Path | None, as_json: bool) -> None:
    """Write the bag and print the result."""
    if output is not None:
        from bmd_rths_msgs_py.record_bag import write_record

        replayed = done.replayed
        directory = new_bag_directory(output, replayed.motion["name"], replayed.configuration["run"]["scheme"])
        result["output"] = str(write_record(replayed, directory))
    if as_json:
        click.echo(json.dumps(result))
    else:
        _show(done, result)


def _show(done: Replay, result: dict[str, Any]) -> None:
    """Print the result as a table."""
    if "rate" in result:
        title = f"{result['motion']}: answers of the nodes, {result['late_steps']} steps played late"
    else:
        changes = (f"{name} {old} → {new}" for name, (old, new) in result["changed"].items())
        title = f"{result['motion']}: {', '.join(changes) or 'parameters as recorded'}"
    differences = done.differences()
    table = Table(title=Text(title), title_justify="left", title_style="bold")
    for column in ("", *differences):
        table.add_column(column.replace("_", " "))
    for label, cell in _ROWS.items():
        table.add_row(label, *(cell(difference) for difference in differences.values()))
    Console(soft_wrap=True).print(table)
    for name in differences:
        stretches = (f"{first} to {last}" if last > first else str(first) for first, last in done.unknown_steps(name))
        if steps := ", ".join(stretches):
            click.echo(f"{name.replace('_', ' ')} is not compared at steps {steps}: what led to it is not recorded")
    if "output" in result:
        click.echo(f"bag: {result['output']}")


def _differing(difference: SignalDifference) -> str:
    if difference.compared == 0:
        return "not known"
    if difference.differing == 0:
        return "none, equal bit for bit"
    return f"{difference.differing}, the first is {difference.first_step}"


def _rmse(difference: SignalDifference) -> str:
    return f"{difference.rmse:.4g} N ({difference.rmse_percent:.4g} %)"


def _largest(difference: SignalDifference) -> str:
    step = difference.largest_step
    return f"{difference.largest:.4g} N" + ("" if step is None else f" at step {step}")


_ROWS: dict[str, Callable[[SignalDifference], str]] = {
    "steps compared": lambda difference: str(difference.compared),
    "steps that differ": _differing,
    "steps without a value": lambda difference: str(difference.missing),
    "RMSE": _rmse,
    "largest difference": _largest,
}


def _libraries(done: Replay) -> str:
    """Return the libraries whose version is not that of the recording: the last bit may differ."""
    before, now = done.recorded.versions, done.replayed.versions
    others = [f"{name} {before.get(name)} there, {now[name]} here" for name in now if before.get(name) != now[name]]
    return ", ".join(others) or "the libraries are the same"
