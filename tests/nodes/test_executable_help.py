"""`--help` of an executable, and words on its command line that mean nothing."""

import pytest

from bmd_rths_core.config import SECTIONS
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import specs
from bmd_rths_nodes.nodes.composed_loop import LOOP_NODES
from bmd_rths_nodes.nodes.recorder import RecorderNode
from bmd_rths_nodes.nodes.table_driver import TableDriverNode
from bmd_rths_nodes.roles import ROLES
from bmd_rths_nodes.ros.executable_help import OWN_PARAMETERS, help_of
from bmd_rths_nodes.ros.spin import run_nodes


@pytest.mark.parametrize("node_types", [[node_type] for node_type in (*LOOP_NODES, RecorderNode)] + [LOOP_NODES])
def test_help_says_what_it_is_and_every_parameter(node_types):
    text = help_of(node_types, ["-h", "--ros-args", "-p", "run.record:=false"])
    sections = {section for node_type in node_types for section in ROLES[node_type.ROLE].sections or SECTIONS}
    wanted = {f"{section}.{key}" for section in sections for key in specs(SECTIONS[section])} | set(OWN_PARAMETERS)
    listed = [line.split(":")[0].strip() for line in text.split("defaults:\n")[1].splitlines() if line[2] != " "]
    assert sorted(listed) == sorted(wanted)
    for node_type in node_types:
        assert node_type.ROLE in text
    assert max(len(line) for line in text.splitlines()) <= 120


def test_services_are_those_that_are_offered():
    text = help_of([TableDriverNode], ["--help"])
    assert "Services:   ~/stop, ~/emergency_stop, ~/reset (std_srvs/srv/Trigger)" in text
    for node_type in (*LOOP_NODES, RecorderNode):
        assert tuple(node_type.operator_services(node_type.__new__(node_type))) == node_type.SERVICES


def test_executable_prints_its_help_without_ros_and_refuses_other_words(capsys):
    assert run_nodes([TableDriverNode], ["--help"]) == 0
    assert capsys.readouterr().out.startswith("Usage: table_driver [--ros-args")
    assert run_nodes([TableDriverNode], ["--halp"]) == 2
    assert capsys.readouterr().err == (
        "error: --halp: unknown; what is for ROS stands after --ros-args, and --help lists parameters\n"
    )


def test_words_of_ros_are_left_to_ros():
    assert help_of([TableDriverNode], ["--ros-args", "-p", "a:=b", "--"]) == ""
    with pytest.raises(InputError, match="more: unknown"):
        help_of([TableDriverNode], ["--ros-args", "-p", "a:=b", "--", "more"])
