"""A compensator that owns the interface, on the ROS graph."""

import pytest

from tests.nodes.conftest import CONFIG


@pytest.mark.parametrize("executable", ["numerical_substructure", "composed_loop"])
def test_nodes_refuse_an_interface_control_in_one_line(start, executable):
    module = f"bmd_rths_nodes.nodes.{executable}"
    result = start("-m", module, "--ros-args", "--params-file", CONFIG, "-p", "run.scheme:=mpic").wait()
    assert result.status == 2
    assert "error: run.scheme: mpic runs in process only" in result.errors


def test_run_refuses_an_interface_control_before_anything_is_written(bmd_rths, tmp_path):
    result = bmd_rths("run", CONFIG, "--scheme", "mpic", "--output", tmp_path / "bags").wait()
    assert (result.status, result.output) == (2, "")
    assert result.errors.startswith("error: run.scheme: mpic runs in process only")
    assert result.errors.count("\n") == 1
    assert not (tmp_path / "bags").exists()
