"""`commission` walks through sensors and limits, writes a protocol, and `run` says how old it is."""

import json
import shutil
from pathlib import Path

import pytest
import yaml

from bmd_rths_nodes.cli.commission import age_in_words

CONFIG = Path(__file__).parents[2] / "config" / "simplified_bmd.yaml"


@pytest.mark.slow
def test_a_rig_in_order_passes_and_leaves_a_protocol(run_main, tmp_path):
    config = shutil.copy(CONFIG, tmp_path / "rig.yaml")
    assert "no protocol" in age_in_words(str(config))
    status, output, errors = run_main("commission", config, "--stop-confirmed", "--json")
    told = json.loads(output)
    assert (status, told["passed"]) == (0, True), errors
    steps = [step["step"] for step in told["steps"]]
    assert "polarity, accelerometer of floor 2" in steps
    assert "limit of force, on the simulated table" in steps
    assert steps[-1] == "emergency stop"
    written = json.loads((tmp_path / "rig.commissioning.json").read_text())
    assert written["steps"] == told["steps"]
    assert age_in_words(str(config)).startswith("commissioning: passed 0 days ago")


@pytest.mark.slow
def test_a_sensor_with_the_wrong_sign_and_a_stop_nobody_tried_fail(run_main, tmp_path):
    config = shutil.copy(CONFIG, tmp_path / "rig.yaml")
    status, output, _ = run_main("commission", config, "--set", "sensors.base_shear_scale=-1.0")
    assert status == 1
    failed = [line for line in output.splitlines() if line.startswith("FAILED")]
    assert len(failed) == 2, output
    assert "load cells: moves against the table" in failed[0]
    assert "emergency stop: not confirmed" in failed[1]
    assert "NOT passed" in age_in_words(str(config))


@pytest.mark.slow
def test_zeros_that_were_found_make_a_rig_with_offsets_pass(run_main, tmp_path):
    config, zero = shutil.copy(CONFIG, tmp_path / "rig.yaml"), tmp_path / "zero.yaml"
    off = ("--set", "sensors.table_displacement_offset=-0.02", "--set", "sensors.floor_offsets=[0.0, 0.5]")
    off = (*off, "--set", "sensors.floor_scales=[1.0, 2.0]")
    arguments = ("commission", config, "--stop-confirmed", "--try-stop", *off)
    status, output, _ = run_main(*arguments, "--zero", zero)
    assert status == 1
    assert "FAILED noise floor and zero, displacement of the table: zero at 0.02" in output
    assert "ok     emergency stop of the controller" in output
    found = yaml.safe_load(zero.read_text())["/**"]["ros__parameters"]["sensors"]
    assert found["table_displacement_offset"] == pytest.approx(0.0, abs=1e-4)
    assert found["floor_offsets"] == pytest.approx([0.0, 0.0], abs=5e-3)
    scales = ("--set", "sensors.floor_scales=[1.0, 2.0]")
    status, output, _ = run_main("commission", config, "--stop-confirmed", "--model", zero, *scales)
    assert "FAILED noise floor and zero" not in output
