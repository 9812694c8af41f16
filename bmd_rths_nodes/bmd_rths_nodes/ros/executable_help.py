"""What ``--help`` of an executable prints: what it is, its topics and services, and every parameter."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from bmd_rths_core.config import SECTIONS, Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import specs
from bmd_rths_nodes.roles import COMPOSED_LOOP, ROLES

if TYPE_CHECKING:
    from bmd_rths_nodes.ros.stage_node import StageNode

#: Parameters of every node that are no part of the configuration: default, description.
OWN_PARAMETERS = {
    "autostart": (True, "Configure and activate the node when it starts"),
    "exit_when_done": (
        False,
        "End the process when a test is over: it has ended, the table is at rest, the bag is closed",
    ),
}

_WIDTH, _INDENT = 110, 6


def help_of(node_types: Sequence[type[StageNode]], arguments: Sequence[str]) -> str:
    """Return the help of an executable where it is asked for, "" where not.

    Parameters
    ----------
    node_types : sequence of type
        Its nodes.
    arguments : sequence of str
        Its command line, without its name.

    Raises
    ------
    InputError
        There are words that mean nothing to a node.
    """
    words = list(_words_not_of_ros(arguments))
    if "--help" in words or "-h" in words:
        return "\n".join(_lines(node_types))
    if words:
        raise InputError(f"{words[0]}: unknown; what is for ROS stands after --ros-args, and --help lists parameters")
    return ""


def _words_not_of_ros(arguments: Sequence[str]) -> Iterator[str]:
    of_ros = False
    for word in arguments:
        if word in ("--ros-args", "--"):
            of_ros = word == "--ros-args"
        elif not of_ros:
            yield word


def _lines(node_types: Sequence[type[StageNode]]) -> Iterator[str]:
    name = node_types[0].ROLE if len(node_types) == 1 else COMPOSED_LOOP
    yield f"Usage: {name} [--ros-args [--params-file FILE] [-p NAME:=VALUE]... [-r __ns:=/NAMESPACE]]"
    yield ""
    yield (sys.modules[node_types[0].__module__].__doc__ or name).strip()
    yield ""
    if len(node_types) > 1:
        yield f"Nodes: {', '.join(node_type.ROLE for node_type in node_types)}"
    else:
        role = ROLES[name]
        for label, topics in (("Listens to: ", role.hears), ("Publishes:  ", role.publishes)):
            listed = ", ".join(topic.name for topic in topics)
            yield textwrap.fill(label + listed, _WIDTH, subsequent_indent=" " * len(label))
        if services := node_types[0].SERVICES:
            yield f"Services:   {', '.join(f'~/{service}' for service in services)} (std_srvs/srv/Trigger)"
    yield "Exit status: 0 after Ctrl-C, 2 when it refuses its parameters; exit_when_done: 1 unless the test finished."
    yield ""
    yield "Parameters, with their defaults:"
    for own, (default, description) in OWN_PARAMETERS.items():
        yield from _entry(own, default, "", "", description)
    sections = [ROLES[node_type.ROLE].sections or tuple(SECTIONS) for node_type in node_types]
    values = Config().as_mapping()
    for section in dict.fromkeys(section for some in sections for section in some):
        for key, spec in specs(SECTIONS[section]).items():
            value = values[section][key]
            allowed = "" if isinstance(value, bool) else spec.allowed()
            yield from _entry(f"{section}.{key}", value, spec.unit, allowed, spec.description)


def _entry(name: str, default: object, unit: str, allowed: str, description: str) -> Iterator[str]:
    shown = str(default).lower() if isinstance(default, bool) else default
    yield f"  {name}: {shown}{f' {unit}' if unit not in ('', '1') else ''}"
    text = f"{description}.{f' Allowed: {allowed}.' if allowed else ''}"
    yield textwrap.indent(textwrap.fill(text, _WIDTH - _INDENT), " " * _INDENT)
