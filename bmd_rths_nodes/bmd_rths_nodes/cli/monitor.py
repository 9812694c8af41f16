"""``bmd-rths monitor``: show the run on this ROS domain, live in the terminal or, with recordings, on a page."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from bmd_rths_msgs_py.topics import NAMESPACE, ROLES
from bmd_rths_nodes.cli.configuration import ConfigChoice
from bmd_rths_nodes.cli.interrupts import collected_interrupts
from bmd_rths_nodes.cli.options import json_option, log, namespace_option
from bmd_rths_nodes.cli.results import without_nan
from bmd_rths_nodes.cli.ros_required import require_ros

if TYPE_CHECKING:
    from bmd_rths_nodes.run.monitor import RunMonitor

#: Time between two pictures [s]; nodes tell their status once a second while a test runs.
_PERIOD = 0.25

#: Longest wait for a node that is not discovered yet [s], since the last one was heard of: Fast DDS repeats its
#: announcements every 3 s. A node that is discovered tells its status once a second, and is waited for longer.
_DISCOVERY_WAIT = 4.0
_LONGEST_WAIT = 15.0

#: A node that has told nothing for this long is shown as silent [s].
_SILENT = 2.5

_UNITS = {"displacement": (1e3, "mm"), "acceleration": (1.0, "m/s²"), "force": (1e-3, "kN")}
_QUANTITIES = {"displacement": "displacement", "acceleration": "command", "force": "actuator force"}


@click.command(epilog="Example: bmd-rths monitor --web")
@click.argument("recordings", metavar="[BAG|FOLDER]", required=False, type=click.Path(path_type=Path))
@click.option("--once", is_flag=True, help="Print one picture and leave.")
@click.option("--web", is_flag=True, help="Show a page for a browser on this computer, with STOP and EMERGENCY STOP.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page. [default: any that is free]")
@click.option(
    "--foxglove",
    type=click.IntRange(0, 65535),
    metavar="PORT",
    help="Let Foxglove watch too, on this port; read-only.",
)
@click.option("--topics", metavar="CONFIG", help="Listen to the topics, where no recorder writes on this computer.")
@namespace_option
@json_option
def monitor(
    recordings: Path | None,
    once: bool,
    web: bool,
    port: int,
    foxglove: int | None,
    topics: str | None,
    namespace: str,
    as_json: bool,
) -> int:
    """Watch the run on this ROS domain: nodes, deadlines, table, limits and recording.

    It only listens to /diagnostics; a test neither notices it nor waits for it. Ctrl-C ends it and nothing else.

    --web shows every signal as well, from the bag while it is written: the page listens to no topic. With a BAG, or a
    FOLDER of bags or of a campaign, it shows that recording and needs no ROS. --topics CONFIG listens instead, best
    effort, where the recorder is on another computer; CONFIG is that of the test.

    --json implies --once; with --web it prints the address.
    """
    from bmd_rths_nodes.cli import monitor_web

    if once and (web or recordings is not None):
        raise click.UsageError("--once prints a picture, --web and BAG show a page; one of them is required")
    if foxglove is not None and not web and recordings is None:
        raise click.UsageError("--foxglove belongs to --web")
    if topics is not None and (not web or recordings is not None):
        raise click.UsageError("--topics belongs to --web without a recording")
    if recordings is not None:
        with collected_interrupts() as interrupts:
            return monitor_web.show_recordings(recordings, port, foxglove, as_json, interrupts)
    config = None if topics is None else ConfigChoice(topics).resolve()
    require_ros("monitor")
    from bmd_rths_nodes.run.monitor import RunMonitor

    with collected_interrupts() as interrupts, RunMonitor(namespace) as run:
        if web:
            return monitor_web.show_graph(run, port, foxglove, config, as_json, interrupts)
        if once or as_json:
            return _print_once(run, as_json, interrupts)
        with Live(console=Console(), auto_refresh=False) as live:
            while not interrupts:
                run.update(_PERIOD)
                snapshot = _snapshot(run)
                page = _page(snapshot) if snapshot["nodes"] else Text(f"{_nothing(run)}; waiting for one (Ctrl-C ends)")
                live.update(page, refresh=True)
    return 0


def _print_once(run: RunMonitor, as_json: bool, interrupts: Sequence[int]) -> int:
    """Print one picture when every role has told its status, or when no more is to be expected."""
    _listen_until_all_have_told(run, interrupts)
    snapshot = _snapshot(run)
    if not snapshot["nodes"]:
        log(f"error: {_nothing(run)}")
        return 1
    if as_json:
        click.echo(json.dumps(without_nan(snapshot)))
    else:
        Console().print(_page(snapshot))
    return 0


def _listen_until_all_have_told(run: RunMonitor, interrupts: Sequence[int]) -> None:
    """Listen until every role, or every role that is discovered, has told its status, or until Ctrl-C."""
    heard, since = 0, time.perf_counter()
    while not set(ROLES) <= set(run.live) and not interrupts:
        run.update(0.05)
        now = time.perf_counter()
        if len(run.live) > heard:
            heard, since = len(run.live), now
        silent = set(run.nodes_there()) - set(run.live)
        if now > since + (_LONGEST_WAIT if silent else _DISCOVERY_WAIT):
            return


def _nothing(run: RunMonitor) -> str:
    words = f"no run is on ROS domain {os.environ.get('ROS_DOMAIN_ID') or 0}"
    if run.namespace != NAMESPACE:
        words += f" in {run.namespace}"
    others = run.other_namespaces()
    return f"{words}; one is in {', '.join(others)} (--namespace)" if others else words


def _snapshot(run: RunMonitor) -> dict[str, Any]:
    from bmd_rths_nodes.run.graph_state import take_snapshot

    now = time.perf_counter()
    return take_snapshot(run.live, {role: now - heard for role, heard in run.heard.items()}, run.nodes_there())


def _page(snapshot: dict[str, Any]) -> RenderableType:
    """Return the page."""
    parts: list[RenderableType] = [_nodes(snapshot["nodes"])]
    if snapshot["test"]:
        parts.append(_test(snapshot["test"]))
    if snapshot["table"]:
        parts.append(_table(snapshot["table"]))
    recording = snapshot["recording"]
    if recording:
        size = "" if recording["bytes"] is None else f", {1e-6 * recording['bytes']:.1f} MB"
        parts.append(Text(f"bag: {recording['bag']} ({recording['messages']} messages{size})"))
    return Group(*parts)


def _nodes(nodes: dict[str, Any]) -> Table:
    from bmd_rths_nodes.run.graph_state import COUNTS

    table = Table(title="nodes", title_justify="left", title_style="bold")
    for column in ("node", "state", "messages lost", "told"):
        table.add_column(column)
    for role, node in nodes.items():
        silent = node["state"] is None or not node["there"] or node["told_s_ago"] > _SILENT
        state = node["state"] or "not known"
        counts = (f"{node[name]} {name.replace('_', ' ')}" for name in COUNTS if node.get(name))
        message = "" if node["message"] == state else node["message"]
        if not node["there"]:
            message = "gone"
        elif node["state"] is not None and silent:
            message = f"silent for {node['told_s_ago']:.0f} s"
        style = "red" if silent or state == "tripped" else ""
        table.add_row(role, Text(state, style), Text(", ".join(counts)), Text(message, style))
    return table


def _test(test: dict[str, Any]) -> Table:
    closure = ", ".join(f"{name} {value:.2f}" for name, value in test["closure_ms"].items() if value is not None)
    rows = {
        "step": f"{test['step']} of {test['steps']}, {test['clock']}",
        "missed deadlines": f"{test['missed_deadlines']}, at most {test['max_consecutive_misses']} in a row",
        "closure of a step": f"{closure} ms" if closure else "",
        "stability indicator": f"{test['stability_indicator']}",
        "waiting for": test["waiting_for"],
        "trip": test["trip"],
        "outcome": test["outcome"],
    }
    return _two_columns("test", rows)


def _table(table: dict[str, Any]) -> Table:
    rows = {"controller": f"{table['controller']}, {table['table']}", "supervisor": table["supervisor"]}
    for name, (scale, unit) in _UNITS.items():
        motion = table[name]
        if None not in motion.values():
            now, peak, limit = (scale * motion[key] for key in ("now", "peak", "limit"))
            share = f", {100 * peak / limit:.0f} % of the limit {limit:.4g}"
            rows[_QUANTITIES[name]] = f"{now:.3g} {unit}, at most {peak:.3g}{share}"
    rows["trips"] = "\n".join(table["trips"])
    return _two_columns("table", rows)


def _two_columns(title: str, rows: dict[str, str]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", show_header=False)
    for name, value in rows.items():
        if value:
            table.add_row(name, Text(value))
    return table
