"""`bmd-rths`: results in process, and one clear line with exit status 2 for everything that is wrong."""

import json
import os
import subprocess
import sys

import pytest

from bmd_rths_core.analysis.metrics import run_metrics
from bmd_rths_core.config import load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.cli.main import COMMANDS
from bmd_rths_nodes.run.bag_names import new_bag_directory
from tests.nodes.conftest import CONFIG


@pytest.mark.slow
def test_simulate_prints_the_metrics_of_the_loop_in_process(run_main):
    status, output, _ = run_main("simulate", CONFIG, "--scheme", "fc", "--json")
    assert status == 0
    result = json.loads(output)
    config = load_config(CONFIG).changed(run__scheme="fc")
    expected = run_metrics(RthsLoop(config, select_ground_motion(config.ground_motion, 0.005)).run())
    assert result["rmse_percent"] == expected.rmse_percent
    assert result["tracking_delay_ms"] == expected.tracking_delay_ms
    assert (result["scheme"], result["motion"], result["steps"]) == ("fc", "el_centro_1940_ns", 3599)
    assert (result["stable"], result["outcome"]) == (True, "finished")


def test_simulate_can_write_a_bag_that_analyze_reads(run_main, tmp_path):
    arguments = ("--set", "ground_motion.duration=2.0", "--output", tmp_path / "out", "--json")
    status, output, _ = run_main("simulate", CONFIG, *arguments)
    assert status == 0
    result = json.loads(output)
    assert read_bag(result["bag"]).steps == 401
    status, again, _ = run_main("analyze", result["bag"], "--json")
    assert status == 0
    assert json.loads(again) == result


def test_table_for_a_person_tells_errors_and_bag(run_main, tmp_path):
    _, output, _ = run_main("simulate", CONFIG, "--set", "ground_motion.duration=1.0", "--output", tmp_path)
    for text in (
        "RMSE substructure",
        "RMSE superstructure",
        "tracking delay",
        "finished",
        "virtual laboratory",
        "bag: ",
    ):
        assert text in output


def test_text_in_brackets_is_no_markup(run_main):
    _, output, _ = run_main(
        "simulate", CONFIG, "--set", "safety.acceleration_limit=1.0", "--set", "safety.ramp_acceleration=1.0"
    )
    assert "safety.acceleration_limit [m/s2] passed" in " ".join(output.split())


def test_bare_command_shows_its_help_with_status_2(run_main):
    status, output, errors = run_main()
    assert (status, output) == (2, "")
    assert "Usage: bmd-rths" in errors
    assert errors.count("\n") > 5


def test_recordings_of_the_same_second_get_directories_of_their_own(tmp_path):
    made = {new_bag_directory(tmp_path, "motion", "uc") for _ in range(5)}
    assert len(made) == 5
    assert all(path.is_dir() for path in made)


def test_unstable_simulation_is_reported_and_has_status_1(run_main):
    status, output, _ = run_main(
        "simulate", CONFIG, "--set", "safety.acceleration_limit=1.0", "--set", "safety.ramp_acceleration=1.0", "--json"
    )
    assert status == 1
    assert json.loads(output)["stable"] is False


@pytest.mark.parametrize("command", [(), *((name,) for name in COMMANDS)], ids=" ".join)
def test_help_has_an_example(run_main, command):
    status, output, _ = run_main(*command, "--help")
    assert status == 0
    assert ("Example: bmd-rths" in output) == bool(command)


AT2 = """PEER
Event
ACCELERATION TIME SERIES IN UNITS OF G
NPTS=   4, DT=   {dt} SEC
  .1E-01  {value}  .1E-01  .0E+00
"""

#: What is wrong: the configuration file, further arguments, and what the one line must name.
WRONG = {
    "missing record": ("good.yaml", ["--motion", "no.at2"], ["no.at2", "No such file"]),
    "NaN in the record": ("good.yaml", ["--motion", "nan.at2"], ["nan.at2", "line 5", "NaN"]),
    "too few values": ("good.yaml", ["--motion", "short.at2"], ["short.at2", "3", "4"]),
    "malformed record": ("good.yaml", ["--motion", "text.at2"], ["text.at2"]),
    "unknown record format": ("good.yaml", ["--motion", "record.xyz"], ["record.xyz", "AT2", "CSV"]),
    "record is a folder": ("good.yaml", ["--motion", "folder.at2"], ["folder.at2", "directory"]),
    "time step is no divisor": ("good.yaml", ["--motion", "odd.at2"], ["0.007", "0.005"]),
    "duration beyond the record": ("good.yaml", ["--set", "ground_motion.duration=99.0"], ["99", "17.9909"]),
    "negative mass": (
        "good.yaml",
        ["--set", "specimen.masses=[-760.0, 800.0]"],
        ["specimen.masses", "-760", ">= 0.1 kg"],
    ),
    "unknown key": ("good.yaml", ["--set", "specimen.mases=[1.0]"], ["specimen.mases", "unknown parameter"]),
    "old name": (
        "good.yaml",
        ["--set", "safety.stale_shear_limit=20"],
        ["safety.stale_shear_limit is now safety.stale_shear_time, in seconds; 20 steps of 0.005 s are 0.1 s"],
    ),
    "old name in the file": (
        "old.yaml",
        [],
        ["old.yaml: command_shaper.alpha is now command_shaper.lead_time, in seconds; 0.025 steps of 0.005 s are"],
    ),
    "unknown section": ("good.yaml", ["--set", "speciment.masses=[1.0]"], ["speciment", "unknown section"]),
    "unstable PLC weights": ("good.yaml", ["--set", "command_shaper.w1=0.5"], ["W1 = 0.5", "|W1| > 1"]),
    "malformed setting": ("good.yaml", ["--set", "lead_time=0.025"], ["--set lead_time=0.025", "SECTION.KEY=VALUE"]),
    "unknown scheme": ("good.yaml", ["--scheme", "plcfc"], ["plcfc", "plc_fc"]),
    "unwritable output": ("good.yaml", ["--output", "a_file/out"], ["a_file/out", "cannot be written"]),
    "unknown option": ("good.yaml", ["--shceme", "uc"], ["--shceme"]),
    "unstable weights in the file": ("unstable.yaml", [], ["unstable.yaml", "W1 = 0.5"]),
    "unknown key in the file": ("unknown.yaml", [], ["unknown.yaml", "command_shaper.lead", "lead_time"]),
    "missing configuration": ("none.yaml", [], ["none.yaml", "No such file"]),
    "unknown configuration": ("simplyfied", [], ["simplyfied", "no such file and no installed configuration"]),
}


@pytest.fixture
def wrong_files(tmp_path):
    """Write the files that `WRONG` names."""
    good = CONFIG.read_text()
    texts = {
        "good.yaml": good,
        "unstable.yaml": good.replace("w1: 2.0", "w1: 0.5"),
        "unknown.yaml": good.replace("lead_time:", "lead:"),
        "old.yaml": good.replace("lead_time:", "alpha:"),
        "nan.at2": AT2.format(dt=".0200", value="NaN"),
        "short.at2": AT2.format(dt=".0200", value=""),
        "odd.at2": AT2.format(dt=".0070", value=".2E-01"),
        "text.at2": "this is no record\n",
        "record.xyz": "words\n",
        "a_file": "",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "folder.at2").mkdir()
    return set(texts) | {"folder.at2"}


@pytest.mark.parametrize("command", ["run", "simulate"])
@pytest.mark.parametrize("case", WRONG.values(), ids=WRONG)
def test_wrong_input_has_status_2_and_one_clear_line_and_nothing_is_written(
    run_main, wrong_files, tmp_path, command, case
):
    config, arguments, named = case
    status, output, errors = run_main(command, config, *arguments)
    assert status == 2
    assert output == ""
    assert errors.startswith("error: ")
    assert errors.count("\n") == 1
    for text in named:
        assert text in errors
    assert {path.name for path in tmp_path.iterdir()} == wrong_files


@pytest.mark.parametrize(
    ("bag", "named"), [("nothing", ["nothing"]), ("empty", ["empty"]), ("text.mcap", ["text.mcap"])]
)
def test_what_is_no_bag_is_refused(run_main, tmp_path, bag, named):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mcap").write_text("this is no bag")
    status, output, errors = run_main("analyze", bag)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    for text in named:
        assert text in errors


def test_installed_configuration_can_be_named(run_main, monkeypatch, tmp_path):
    share = tmp_path / "prefix" / "share"
    (share / "ament_index/resource_index/packages").mkdir(parents=True)
    (share / "ament_index/resource_index/packages/bmd_rths_nodes").write_text("")
    (share / "bmd_rths_nodes/config").mkdir(parents=True)
    (share / "bmd_rths_nodes/config/simplified_bmd.yaml").write_text(CONFIG.read_text())
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    status, _, errors = run_main("simulate", "simplified_bmd", "--set", "ground_motion.duration=1.0")
    assert status == 0, errors


def test_interrupted_simulation_leaves_no_empty_folder(run_main, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(RthsLoop, "run", interrupted)
    status, output, errors = run_main("simulate", CONFIG, "--output", tmp_path / "new" / "bags")
    assert (status, output, errors.strip()) == (1, "", "stopped")
    assert not (tmp_path / "new").exists()


def test_stability_of_stories_that_yield_says_what_was_looked_at(run_main):
    changes = ("nonlinear.story_model=bilinear", "nonlinear.integration=cr", "nonlinear.yield_drifts=[0.0003]")
    options = [word for change in changes for word in ("--set", change)]
    _, output, _ = run_main("stability", CONFIG, "--no-sensitivity", *options)
    assert "The stories are bilinear: this is their elastic range" in output
    assert "elastic range" not in run_main("stability", CONFIG, "--no-sensitivity")[1]


@pytest.mark.parametrize(("given", "expected"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_linear_algebra_has_one_thread_unless_told_otherwise(given, expected):
    """The variable counts when numpy is imported, which the package itself must therefore not do first."""
    statement = "import os, sys, bmd_rths_nodes; print('numpy' in sys.modules, os.environ['OPENBLAS_NUM_THREADS'])"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"} | given
    child = subprocess.run([sys.executable, "-c", statement], env=environment, capture_output=True, timeout=120)
    assert child.stdout.split() == [b"False", expected.encode()], child.stderr
