"""YAML of bounded size: a key given twice, a file without an end and aliases that multiply are refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from bmd_rths_core.errors import InputError

#: Largest file [bytes], deepest nesting and most nodes behind all aliases; a configuration has 10 kB, 4 and 300.
MAX_BYTES = 1_000_000
MAX_DEPTH = 30
MAX_NODES = 100_000


def read_yaml(path: str | Path) -> Any:
    """Read a YAML file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Any
        Its document.

    Raises
    ------
    InputError
        It cannot be read, is no YAML, or is larger than a configuration can be; the file is named.
    """
    try:
        with open(path, "rb") as file:
            content = file.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES // 1000} kB; no configuration is")
        text = content.decode("utf-8-sig")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    return parse_yaml(text, str(path))


def parse_yaml(text: str, name: str) -> Any:
    """Return the document of a YAML text.

    Parameters
    ----------
    text : str
        The text.
    name : str
        Where it comes from, for the message.

    Raises
    ------
    InputError
        It is no YAML, or nests too deep, or has too many nodes.
    """
    try:
        return yaml.load(text, Loader=_BoundedLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" line {mark.line + 1}" if mark else ""
        problem = " ".join(str(getattr(error, "problem", None) or error).split())
        raise InputError(f"{name}{where}: not valid YAML: {problem}") from error
    except (ValueError, TypeError, OverflowError, RecursionError) as error:  # of a date in month 13, say
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{name}: not valid YAML: {problem}") from error


class _BoundedLoader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
    """YAML that refuses a key given twice instead of keeping the last one, and what never ends."""

    def __init__(self, stream: Any) -> None:
        super().__init__(stream)
        self._depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            problem = f"nested more than {MAX_DEPTH} deep"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=self.peek_event().start_mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _count(node, {})
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Any:
        seen = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(problem="a key that is no word", problem_mark=key_node.start_mark)
            key = key_node.value
            if key in seen:
                raise yaml.MarkedYAMLError(problem=f"{key!r} is given twice", problem_mark=key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)


def _count(node: yaml.Node, counted: dict[int, int]) -> int:
    """Return how many nodes there are with every alias written out."""
    if id(node) in counted:
        if counted[id(node)] == 0:
            raise yaml.MarkedYAMLError(problem="an alias that holds itself", problem_mark=node.start_mark)
        return counted[id(node)]
    counted[id(node)] = 0
    total = 1
    if isinstance(node, yaml.CollectionNode):
        for entry in node.value:
            total += sum(_count(part, counted) for part in (entry if isinstance(entry, tuple) else (entry,)))
    if total > MAX_NODES:
        problem = f"more than {MAX_NODES} values with all aliases written out"
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
    counted[id(node)] = total
    return total


# YAML 1.2 and ROS take 8e6 and 1e-6 for numbers; PyYAML wants a dot and a sign for it.
_BoundedLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$"), list("-+.0123456789")
)
