"""`bmd-rths campaign --ros`: the study of the campaign on the ROS graph, every result from a bag."""

import json
import os
import signal
from pathlib import Path

import pytest

from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.campaign.results import CSV_NAME
from tests.nodes.conftest import CONFIG, processes_of_domain, wait_until

#: A second of saw teeth, which are as fast as they stand in the file.
RECORD = "time_s,acceleration_g\n" + "".join(f"{0.01 * i:.2f},{{}}\n" for i in range(100))
AS_RECORDED = ("--set", "ground_motion.time_scale=1.0")


@pytest.fixture
def records(tmp_path):
    folder = tmp_path / "records"
    folder.mkdir()
    for name, factor in (("kobe", 1), ("other", -2)):
        values = [f"{factor * (i % 20 - 10) / 100:.3f}" for i in range(100)]
        (folder / f"{name}.csv").write_text(RECORD.format(*values))
    return folder


def campaign(output, *arguments):
    return ("campaign", CONFIG, *AS_RECORDED, "--output", output, *arguments)


def lines_of(output):
    results = output / CSV_NAME
    return results.read_text().splitlines()[1:] if results.exists() else []


def recording(output, size=20_000):
    """Tell whether messages of a test have reached the disk [bytes]."""
    return any(file.stat().st_size > size for file in output.glob("bags/.unfinished/*/*.mcap"))


@pytest.mark.long
@pytest.mark.slow
def test_results_are_those_in_process_and_a_killed_study_goes_on(run_main, bmd_rths, records, domain, tmp_path):
    """SIGKILL in the second run, the same command at once, and once more when a bag was cut and another is lost."""
    output = tmp_path / "out"
    arguments = campaign(output, "--motions", records, "--schemes", "plc_fc", "--json")
    killed = bmd_rths(*arguments, "--ros")
    wait_until(lambda: len(lines_of(output)) == 1 and recording(output))
    killed.process.kill()
    killed.process.wait()
    before = lines_of(output)
    assert len(before) == 1
    again = bmd_rths(*arguments, "--ros").wait()
    assert again.status == 0, again.errors
    assert lines_of(output)[:1] == before
    runs = json.loads(again.output)["runs"]
    assert len({run["key"] for run in runs}) == len(lines_of(output)) == 2
    assert sorted(os.listdir(output / "bags")) == sorted(Path(run["bag"]).name for run in runs)
    assert processes_of_domain(domain) == {}

    status, in_process, _ = run_main(*arguments, "--jobs", 1)
    assert status == 0
    for run, expected in zip(runs, json.loads(in_process)["runs"], strict=True):
        assert run["rmse_percent"] == pytest.approx(expected["rmse_percent"], rel=0.0, abs=1e-9)
        assert run["tracking_delay_ms"] == pytest.approx(expected["tracking_delay_ms"], rel=1e-9)
        assert (run["engine"], expected["engine"]) == ("ros", "linear")
        told = ("motion", "event", "file", "component", "scheme", "variation", "stable", "outcome", "steps")
        assert [run[name] for name in told] == [expected[name] for name in told]
        record = read_bag(run["bag"])
        assert record.configuration["run"] | {"lockstep": True, "preflight": "skip"} == record.configuration["run"]
    lines = lines_of(output)
    assert len(lines) == 4

    # One bag is cut; another one lost its result, as when the study is killed between the two.
    cut, unread = runs[0], runs[1]
    (file,) = Path(cut["bag"]).glob("*.mcap")
    os.truncate(file, file.stat().st_size - 100)
    text = (output / CSV_NAME).read_text()
    (output / CSV_NAME).write_text(
        "".join(line for line in text.splitlines(True) if not line.startswith(unread["key"]))
    )
    made = {run["bag"]: Path(run["bag"], "metadata.yaml").stat().st_mtime_ns for run in runs}
    repaired = bmd_rths(*arguments, "--ros").wait()
    assert repaired.status == 0, repaired.errors
    assert json.loads(repaired.output)["runs"] == runs
    made_anew = [bag for bag, time in made.items() if Path(bag, "metadata.yaml").stat().st_mtime_ns != time]
    assert made_anew == [cut["bag"]]
    assert sorted(lines_of(output)) == sorted(lines)


@pytest.mark.slow
def test_run_that_a_limit_ends_is_a_result(bmd_rths, records, domain):
    arguments = ("--motions", records / "kobe.csv", "--schemes", "uc", "--ros", "--json")
    result = bmd_rths(
        *campaign("out", *arguments, "--set", "safety.acceleration_limit=0.5", "--set", "safety.ramp_acceleration=0.5")
    ).wait()
    assert result.status == 0, result.errors
    (run,) = json.loads(result.output)["runs"]
    assert (run["stable"], run["outcome"], run["rmse_percent"]["substructure"]) == (False, "limit", None)
    assert "safety.acceleration_limit" in run["reason"]
    record = read_bag(run["bag"])
    assert (record.outcome, record.steps) == ("limit", run["steps"])
    assert processes_of_domain(domain) == {}


def long_campaign(bmd_rths, tmp_path):
    """Start a campaign whose runs take long enough for what happens to them."""
    (tmp_path / "el_centro.txt").write_text("el_centro_1940_ns\n")
    motions = ("--motions", tmp_path / "el_centro.txt", "--set", "ground_motion.free_vibration=100.0")
    return bmd_rths("campaign", CONFIG, *motions, "--ros", "--output", tmp_path / "out", "--json")


@pytest.mark.slow
def test_interrupt_brings_the_running_test_to_rest_and_ends_the_study(bmd_rths, domain, tmp_path):
    child = long_campaign(bmd_rths, tmp_path)
    wait_until(lambda: recording(tmp_path / "out", 200_000) or child.process.poll() is not None)
    child.process.send_signal(signal.SIGINT)
    result = child.wait()
    assert (result.status, result.output) == (1, "")
    lines = result.errors.splitlines()
    assert lines[0].startswith("stopping: the table is brought to rest")
    assert lines[-1].startswith("stopped during el_centro_1940_ns, uc; what is finished stays")
    assert lines_of(tmp_path / "out") == os.listdir(tmp_path / "out" / "bags") == []
    assert processes_of_domain(domain) == {}


@pytest.mark.slow
def test_run_that_fails_ends_the_study_in_one_clear_line(bmd_rths, domain, tmp_path):
    child = long_campaign(bmd_rths, tmp_path)
    wait_until(lambda: recording(tmp_path / "out", 200_000) or child.process.poll() is not None)
    (recorder,) = (pid for pid, command in processes_of_domain(domain).items() if "nodes.recorder" in command)
    os.kill(recorder, signal.SIGKILL)
    result = child.wait()
    assert (result.status, result.output) == (1, "")
    (line,) = result.errors.splitlines()
    assert line.startswith("error: el_centro_1940_ns, uc: recorder ended with status -9")
    assert line.endswith("what is finished stays, the same command goes on where it was")
    assert lines_of(tmp_path / "out") == os.listdir(tmp_path / "out" / "bags") == []
    assert processes_of_domain(domain) == {}


def test_taken_domain_ends_the_study_in_one_clear_line(run_main, records, monkeypatch):
    class Monitor:
        namespace = "/rths"

        def __init__(self, discovery_time):
            assert discovery_time > 3.0

        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        def forget_run(self, longest):
            assert longest > 3.0

        def nodes_already_there(self):
            return ["command_shaper"]

        def believe_only(self, believes):
            return None

    monkeypatch.setattr("bmd_rths_nodes.campaign.on_ros.RunMonitor", Monitor)
    status, output, errors = run_main(*campaign("out", "--motions", records, "--ros", "--json"))
    assert (status, output) == (1, "")
    (line,) = errors.splitlines()
    assert line.startswith("error: kobe, uc: another run is active on this ROS domain (command_shaper)")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("--jobs", 2), "--ros: one run after the other; neither --jobs nor --scheduler is possible"),
        (("--scheduler", "tcp://x:1"), "--ros: one run after the other"),
        (("--vary", "run.lockstep=true,false"), "--vary run.lockstep: is decided by --ros"),
        (("--vary", "recorder.directory=a,b"), "--vary recorder.directory: is decided by --ros"),
    ],
)
def test_what_is_not_possible_on_ros_is_one_clear_line(run_main, records, arguments, problem):
    status, output, errors = run_main(*campaign("out", "--motions", records, "--ros", *arguments))
    assert (status, output) == (2, "")
    assert errors.startswith(f"error: {problem}")
    assert len(errors.splitlines()) == 1
    assert not Path("out").exists()
