"""`new-rig` writes what `check` understands, from options or questions; mistakes end in one line."""

import json

import numpy as np
import pytest

from bmd_rths_core.config import load_config
from bmd_rths_core.new_rig import Rig, Structure, rig_text
from tests.core.test_measured_table import measured, write

OPTIONS = (
    *("--stroke", "0.1", "--velocity", "0.5", "--acceleration", "10", "--force", "1e5"),
    *("--specimen-masses", "1000,900", "--specimen-stiffnesses", "1.5e6,1.2e6"),
    *("--numerical-masses", "20000,20000,18000", "--numerical-stiffnesses", "5e7,4.5e7,4e7"),
)


def test_what_new_rig_writes_passes_check(run_main, tmp_path):
    path = tmp_path / "rig.yaml"
    status, output, _ = run_main("new-rig", path, *OPTIONS, "--rate", "500", "--shear", "load_cell")
    assert (status, output) == (0, f"{path}\n")
    config = load_config(path)
    assert config.run.time_step == 0.002
    assert config.shear_estimator.source == "load_cell"
    assert config.ground_motion.peak_acceleration == 0.0
    assert config.safety.displacement_limit == 0.092
    status, output, errors = run_main("check", path, "--no-predict", "--json")
    told = json.loads(output)
    assert (status, told["warnings"], errors) == (0, [], "")
    assert told["table"]["compensated_ms"] == pytest.approx(told["table"]["delay_ms"], abs=0.06)
    status, output, _ = run_main("check", path, "--no-predict")
    assert status == 0
    assert "mass ratio" in output
    assert "capacity, displacement" in output


def test_a_measured_table_and_matrices_are_told_relative_to_the_file(run_main, tmp_path):
    write(tmp_path / "table.csv", measured(noise=0.01))
    np.savez(tmp_path / "specimen.npz", M=np.diag([1000.0, 900.0]), K=[[2.7e6, -1.2e6], [-1.2e6, 1.2e6]])
    path = tmp_path / "rig.yaml"
    options = (*OPTIONS[:8], *OPTIONS[12:], "--specimen-matrices", tmp_path / "specimen.npz")
    status, _, errors = run_main("new-rig", path, *options, "--table-frf", tmp_path / "table.csv")
    assert status == 0, errors
    text = path.read_text()
    assert "matrices: 'specimen.npz'" in text
    assert "frequency_response: 'table.csv'" in text
    status, output, errors = run_main("check", path, "--no-predict", "--json")
    told = json.loads(output)
    assert told["table"]["fit_error"] == pytest.approx(0.01, rel=0.3)
    assert told["specimen"]["damping_ratios"] == pytest.approx([0.02, 0.02])
    assert "sections fitted to" in errors


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "--specimen-masses: not given; Floor masses of the specimen from the table up [kg], with commas is"),
        ((*OPTIONS, "--specimen-masses", "1,5;2"), "'1,5;2' is not a list of numbers with commas between"),
        ((*OPTIONS, "--specimen-masses", "1000"), "specimen: masses, stiffnesses and damping_coefficients need one"),
        ((*OPTIONS, "--rate", "0.005"), "rate: 0.005 Hz is not allowed"),
        ((*OPTIONS, "--rate", "330"), "time step 0.00303030303 s; ground motion 'el_centro_1940_ns' has 0.02 s"),
        ((*OPTIONS, "--motion", "nowhere.at2"), "nowhere.at2"),
        ((*OPTIONS[:8], *OPTIONS[12:], "--specimen-matrices", "none.npz"), "none.npz: cannot be read"),
        ((*OPTIONS, "--specimen-matrices", "none.npz"), "--specimen-matrices, --specimen-masses: not together"),
    ],
)
def test_mistakes_write_nothing_and_end_in_one_line(run_main, tmp_path, options, message):
    path = tmp_path / "rig.yaml"
    status, output, errors = run_main("new-rig", path, *options)
    assert (status, output, errors.count("\n")) == (2, "", 1), errors
    assert message in errors
    assert not path.exists()


def test_a_file_that_exists_is_kept(run_main, tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("mine")
    status, _, errors = run_main("new-rig", path, *OPTIONS)
    assert (status, errors) == (2, f"error: {path}: exists; --force-write writes over it\n")
    assert path.read_text() == "mine"


def test_numbers_are_written_as_yaml_and_ros_both_read_them():
    """Without a decimal point ROS takes a number for an integer, and YAML one with an exponent for text."""
    stories = Structure((1e3,), (1.5e15,), (0.02,))
    text = rig_text(Rig("test", stories, stories, stroke=1e-5))
    assert "masses: [1000.0]" in text
    assert "stiffnesses: [1.5e+15]" in text
    assert "stroke: 1.0e-05" in text
