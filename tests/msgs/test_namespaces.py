"""Several rigs share a ROS domain: each has a namespace, and its bags say which."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_msgs_py.bag_completeness import namespace_of
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.layouts import foxglove_layout, plotjuggler_layout
from bmd_rths_msgs_py.node_status import is_of_others
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_msgs_py.topics import COMMAND, DIAGNOSTICS, TOPICS, checked_namespace


@pytest.mark.parametrize("text", ["rig1", "/rig1", "lab/rig_1", "/_a/B/c3"])
def test_namespace_gets_its_slash(text: str) -> None:
    assert checked_namespace(text) == "/" + text.removeprefix("/")
    assert COMMAND.full_name_in(checked_namespace(text)) == "/" + text.removeprefix("/") + "/command"
    assert DIAGNOSTICS.full_name_in(checked_namespace(text)) == "/diagnostics"


@pytest.mark.parametrize("text", ["", "/", "//rig", "rig/", "1rig", "rig 1", "~rig", "rig-1", "rig\n", "ríg", "a//b"])
def test_namespace_that_ros_does_not_allow_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="is not allowed; letters, digits and _ are, no digit first"):
        checked_namespace(text)


def test_bag_says_its_namespace_and_a_bag_made_of_it_keeps_it(record: RunRecord, tmp_path: Path) -> None:
    moved = replace(record, namespace="/lab/rig1")
    found = read_bag(write_record(moved, tmp_path / "moved"))
    assert (found.namespace, found.outcome) == ("/lab/rig1", "finished")
    assert found.same_signals(record)
    with next((tmp_path / "moved").glob("*.mcap")).open("rb") as file:
        assert {m.topic.rpartition("/")[0] for _, m, _ in make_reader(file).iter_messages()} == {"/lab/rig1"}
    assert read_bag(write_record(record, tmp_path / "usual")).namespace == "/rths"


def names(namespace: str) -> set[str]:
    return {topic.full_name_in(namespace) for topic in TOPICS.values()}


def test_one_topic_of_somebody_else_is_no_second_test() -> None:
    for namespace in ("/rths", "/rig1"):
        assert namespace_of({*names(namespace), "/robot/arm/command", "/camera"}) == namespace
    with pytest.raises(InputError, match="signals in 2 namespaces"):
        namespace_of(names("/rig1") - {"/rig1/command"} | {"/rig2/command"})  # one test, moved in part
    assert namespace_of({"/rig1/command"}) == "/rig1"  # all that is left of a cut bag
    with pytest.raises(InputError, match="signals in 2 namespaces, '/rig1', '/rths'; one is required"):
        namespace_of(names("/rths") | names("/rig1"))


def test_status_of_another_rig_is_told_from_the_own_and_from_one_of_somebody_else(typestore: Any) -> None:
    types = typestore.types
    status, pair = types["diagnostic_msgs/msg/DiagnosticStatus"], types["diagnostic_msgs/msg/KeyValue"]
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](7, 0), "")

    def message(name: str, hardware: str = "bmd_rths") -> bytes:
        told = [status(0, name, "", hardware, [pair("state", "ready")])]
        array = types["diagnostic_msgs/msg/DiagnosticArray"](header, told)
        return bytes(typestore.serialize_cdr(array, "diagnostic_msgs/msg/DiagnosticArray"))

    assert is_of_others(message("/rig2/recorder"), "/rig1")
    assert not is_of_others(message("/rig1/recorder"), "/rig1")
    assert not is_of_others(message("/camera", "camera"), "/rig1")
    assert not is_of_others(message("/rig2/recorder")[:20], "/rig1")  # a recorder keeps what nobody understands


def test_layouts_show_the_topics_of_a_namespace() -> None:
    for layout in (foxglove_layout(2, "/rig1"), plotjuggler_layout(2, "/rig1")):
        assert "/rig1/command" in layout
        assert "/rths" not in layout
