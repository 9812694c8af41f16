"""One registry of roles: executables, processes, composition and nodes follow from it."""

from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

from bmd_rths_core.config import SECTIONS, Config
from bmd_rths_msgs_py import topics
from bmd_rths_nodes.nodes.command_shaper import CommandShaperNode
from bmd_rths_nodes.nodes.composed_loop import LOOP_NODES
from bmd_rths_nodes.nodes.numerical_substructure import NumericalSubstructureNode
from bmd_rths_nodes.roles import COMPOSED_LOOP, LOOP, ROLES, module_of
from bmd_rths_nodes.ros.stage_node import StageNode
from bmd_rths_nodes.run.execute import COMPOSED_PROCESSES, PROCESSES

PACKAGE = Path(__file__).parents[2] / "bmd_rths_nodes"


def test_the_roles_are_those_of_the_topics():
    assert tuple(ROLES) == topics.ROLES
    for topic in topics.TOPICS.values():
        assert [name for name, role in ROLES.items() if topic in role.hears] == [
            name for name in ROLES if name in topic.consumers
        ]
    for role in LOOP:
        assert role.publishes[-1] is topics.DIAGNOSTICS
        assert len(role.publishes) > 1


@pytest.mark.parametrize("role", ROLES.values(), ids=lambda role: role.name)
def test_the_module_of_a_role_has_its_node(role):
    module = import_module(role.module)
    own = [
        item
        for item in vars(module).values()
        if isinstance(item, type) and issubclass(item, StageNode) and item.__module__ == role.module
    ]
    assert [node.ROLE for node in own] == [role.name]
    assert set(role.sections or SECTIONS) <= set(SECTIONS)


def test_executables_processes_and_composition():
    executables = {*ROLES, COMPOSED_LOOP}
    assert {path.name for path in (PACKAGE / "scripts").iterdir()} == executables
    for path in (PACKAGE / "scripts").iterdir():
        assert f'-m {module_of(path.name)} "$@"' in path.read_text()
    assert [node.ROLE for node in LOOP_NODES] == [role.name for role in LOOP]
    assert tuple(module_of(name) for name in ROLES) == PROCESSES
    assert (module_of(COMPOSED_LOOP), module_of("recorder")) == COMPOSED_PROCESSES


@pytest.mark.parametrize("scheme", ["plc_fc", "ats", "mpic"])
def test_node_that_makes_a_compensator_agrees_on_everything_it_is_made_from(scheme):
    """What two nodes read has to be the same in both; a node reads more than its role declares."""
    asked = SimpleNamespace(config=Config().changed(run__scheme=scheme))
    told = {node: set(node.further_sections(asked)) for node in (NumericalSubstructureNode, CommandShaperNode)}
    model = {"identified_model", "specimen", "shear_estimator", "force_correction", scheme}
    maker = {"ats": CommandShaperNode, "mpic": NumericalSubstructureNode}.get(scheme)
    for node, sections in told.items():
        assert (model <= sections) == (node is maker)
        assert bool(sections) == (node is maker)
