"""The nodes of `examples/my_rths_nodes` take part in a test, in place of ours."""

import os

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from bmd_rths_core.config import Config, dump_config
from bmd_rths_msgs_py.bag_reader import read_bag
from tests.nodes.conftest import ROOT, wait_until

EXAMPLE = ROOT / "examples" / "my_rths_nodes"

#: The three other nodes of the loop, in one process.
OTHERS = (
    "import sys; from bmd_rths_nodes.ros.spin import run_nodes; "
    "from bmd_rths_nodes.nodes.numerical_substructure import NumericalSubstructureNode as N; "
    "from bmd_rths_nodes.nodes.command_shaper import CommandShaperNode as C; "
    "from bmd_rths_nodes.nodes.force_correction import ForceCorrectionNode as F; "
    "sys.exit(run_nodes([N, C, F]))"
)


@pytest.mark.slow
def test_own_estimator_and_own_driver_run_a_test(start, tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(EXAMPLE), os.environ.get("PYTHONPATH", "")]))
    config = Config().changed(
        run__lockstep=True,
        run__scheme="fc",  # a table without delay needs no lead
        ground_motion__duration=0.5,
        table__controller="my_table",
        recorder__directory=str(tmp_path / "bags"),
    )
    (tmp_path / "parameters.yaml").write_text(dump_config(config))
    given = ("--ros-args", "--params-file", tmp_path / "parameters.yaml")
    started = [
        start("-c", OTHERS, *given),
        start("-m", "my_rths_nodes.shear_estimator", *given),
        start("-m", "my_rths_nodes.table_driver", *given),
        start("-m", "bmd_rths_nodes.nodes.recorder", *given),
    ]

    def closed():
        for child in started:
            assert child.process.poll() is None, child.errors.read_text()
        return [f.parent for f in (tmp_path / "bags").glob("*/metadata.yaml") if "outcome" in f.read_text()]

    (bag,) = wait_until(closed)
    record = read_bag(bag)
    assert (record.outcome, record.steps) == ("finished", 101)
    assert record.told_controller == "my_table"
    masses = config.specimen.masses
    expected = [-sum(m * a for m, a in zip(masses, floors, strict=True)) for floors in record.floor_accelerations]
    assert np.array_equal(record.interface_force, expected)
    assert np.abs(record.interface_force).max() > 1.0
    assert np.array_equal(record.table_acceleration, record.command)
    assert record.way_to_rest is not None  # the supervisor is there
    told = statuses(bag)
    assert told["/rths/table_driver"]["supervisor"] == "stopped"
    assert told["/rths/shear_estimator"].keys() == {"state", "run", "instance"}


def statuses(bag):
    """Return the last values that each node told."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic == "/diagnostics"]
        return {
            status.name: {pair.key: pair.value for pair in status.values}
            for connection, _, raw in reader.messages(connections)
            for status in reader.deserialize(raw, connection.msgtype).status
        }


def test_page_shows_the_driver_of_the_example():
    page = (ROOT / "docs" / "how-to" / "write_a_node_of_your_own.md").read_text(encoding="utf-8")
    source = (EXAMPLE / "my_rths_nodes" / "table_driver.py").read_text(encoding="utf-8")
    block = page.split("```python\n")[1].split("```")[0]
    code = [line for line in source.splitlines() if line and '"""' not in line]
    shown = [line for line in block.splitlines() if line]
    begin = code.index(shown[0])
    assert code[begin : begin + len(shown)] == shown


def test_package_is_one_of_ament_and_registers_its_table():
    assert (EXAMPLE / "resource" / "my_rths_nodes").exists()
    assert "<build_type>ament_python</build_type>" in (EXAMPLE / "package.xml").read_text()
    assert '"bmd_rths.table_controllers": [f"my_table = {NAME}.my_table:MyTable"]' in (EXAMPLE / "setup.py").read_text()
