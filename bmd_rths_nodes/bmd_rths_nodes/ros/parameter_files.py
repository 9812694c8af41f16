"""Parameter files of ROS: one that reaches no node is refused, where ROS itself runs on defaults without a word."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.topics import ROLES

_PARAMETERS = "ros__parameters"

#: Every node reads its file when it starts; the loader in C takes a tenth of the time where PyYAML has it.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def refuse_unreached(arguments: Sequence[str], nodes: Sequence[str]) -> None:
    """Refuse parameter files of which nothing reaches a node.

    Parameters
    ----------
    arguments : sequence of str
        Command line of the process, with ``--ros-args``.
    nodes : sequence of str
        Fully qualified names of its nodes.

    Raises
    ------
    InputError
        A node is reached by none of the files, or a file names a node of this project that does not exist.
    """
    keys = {file: sorted(_node_keys(file)) for file in parameter_files(arguments)}
    namespace = nodes[0].rpartition("/")[0]
    roles = [f"{namespace}/{role}" for role in ROLES]
    for file, found in keys.items():
        for key in found:
            ours = key.startswith(f"{namespace}/") or len(found) == 1
            if ours and not any(_reaches(key, role) for role in roles):
                raise InputError(f"{file}: {key} is no node of a test; allowed here: /**, {', '.join(roles)}")
    for node in nodes:
        if keys and not any(_reaches(key, node) for found in keys.values() for key in found):
            told = "; ".join(f"{file} has {', '.join(found) or 'no parameters'}" for file, found in keys.items())
            raise InputError(f"{told}: none of it is for {node}, which would run on defaults; name it, or /**")


def parameter_files(arguments: Sequence[str]) -> list[str]:
    """Return the parameter files of a command line.

    Parameters
    ----------
    arguments : sequence of str
        Command line, with ``--ros-args``.
    """
    found, of_ros = [], False
    for argument, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if argument in ("--ros-args", "--"):
            of_ros = argument == "--ros-args"
        elif of_ros and argument == "--params-file":
            found.append(following)
    return found


def _node_keys(file: str) -> Iterator[str]:
    """Yield the names of the nodes that a file has parameters for, as they would be if they were absolute."""
    try:
        document = yaml.load(Path(file).read_text(encoding="utf-8"), Loader=_LOADER)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    yield from _keys_below(document, "")


def _keys_below(content: Any, name: str) -> Iterator[str]:
    if not isinstance(content, Mapping):
        return
    if _PARAMETERS in content:
        yield name
        return
    for key, below in content.items():
        yield from _keys_below(below, f"{name}/{str(key).strip('/')}")


def _reaches(key: str, node: str) -> bool:
    """Tell whether a key means a node: ``*`` is one part of a name, ``**`` any number of them."""
    parts = [
        "(/[^/]+)*" if part == "**" else "/[^/]+" if part == "*" else f"/{re.escape(part)}"
        for part in key.split("/")[1:]
    ]
    return re.fullmatch("".join(parts), node) is not None
