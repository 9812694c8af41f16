"""`bmd-rths replay`: bags of every kind give their forces again, in process and on the real middleware."""

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import AccelStamped

from bmd_rths_core.config import config_from_mapping, dump_config
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_nodes.ros.playback import Playback
from tests.conftest import WITHOUT_LIMITS
from tests.nodes.conftest import CONFIG, processes_of_domain, recorded, wait_until

FORCES = ("interface_force", "corrected_force")
#: A busy machine must not end a run before what is tested has happened.
PATIENT = {"run__longest_miss_time": 10, "safety__stale_shear_time": 10, **WITHOUT_LIMITS}


def settings(**changes):
    return [word for name, value in changes.items() for word in ("--set", f"{name.replace('__', '.')}={value}")]


@pytest.fixture
def simulated(run_main, tmp_path):
    """Return the bag of a run in process."""
    arguments = (*settings(ground_motion__duration=2.0), "--output", tmp_path / "simulated", "--json")
    return json.loads(run_main("simulate", CONFIG, *arguments)[1])["bag"]


def replayed(run_main, bag, *arguments):
    """Replay a bag in process, which must succeed, and return what is told of its signals."""
    status, output, _ = run_main("replay", bag, *arguments, "--json")
    assert status == 0
    return json.loads(output)


def test_simulated_bag_is_reproduced(run_main, simulated):
    result = replayed(run_main, simulated)
    assert result["reproduced"] is True
    assert result["changed"] == {}
    for name in FORCES:
        assert (result["signals"][name]["compared"], result["signals"][name]["differing"]) == (401, 0)


def test_other_parameters_show_the_difference_and_have_status_0(run_main, simulated, tmp_path):
    (tmp_path / "model.yaml").write_text("/**: {ros__parameters: {shear_estimator: {model_error: 0.3}}}\n")
    result = replayed(run_main, simulated, "--model", "model.yaml", *settings(force_correction__gain=0.2))
    assert result["changed"] == {"shear_estimator.model_error": [0.1, 0.3], "force_correction.gain": [0.5, 0.2]}
    assert result["reproduced"] is False
    assert all(result["signals"][name]["rmse"] > 0.0 for name in FORCES)


def test_replay_can_be_written_as_a_bag_that_replays_itself(run_main, simulated, tmp_path):
    arguments = (*settings(force_correction__gain=0.2), "--output", tmp_path / "out")
    written = replayed(run_main, simulated, *arguments)["output"]
    before, after = read_bag(simulated), read_bag(written)
    assert after.configuration["force_correction"]["gain"] == 0.2
    assert np.array_equal(after.floor_accelerations, before.floor_accelerations)
    assert not np.array_equal(after.corrected_force, before.corrected_force)
    assert replayed(run_main, written)["reproduced"] is True


def test_bag_that_is_not_reproduced_has_status_1_and_one_line_that_says_which_libraries_are_others(
    run_main, simulated, monkeypatch
):
    monkeypatch.setattr("bmd_rths_core.stages.shear_estimator.ShearEstimator.step", lambda stage, measurement: 1.0)
    monkeypatch.setattr("bmd_rths_core.analysis.replay.software_versions", lambda: {"numpy": "0.1"})
    status, output, errors = run_main("replay", simulated)
    assert status == 1
    assert "401, the first is 0" in output
    assert errors.startswith(f"error: {simulated}: not reproduced; numpy ")
    assert errors.endswith("there, 0.1 here\n")


def test_recording_that_began_too_late_to_compare_anything_is_neither_reproduced_nor_wrong(run_main, simulated):
    """The recorder came at step 200: what the filter had seen until then is not known."""
    record = read_bag(simulated)
    for signal_ in record.signals().values():
        signal_[:200] = np.nan
    late = write_record(record, Path("late"))
    status, output, _ = run_main("replay", late, "--json")
    assert (status, json.loads(output)["reproduced"]) == (0, None)
    assert json.loads(output)["signals"]["interface_force"]["unknown_steps"] == [[200, 400]]
    assert "not known" in run_main("replay", late)[1]


@pytest.mark.parametrize("share", [0.3, 0.5, 0.77, 0.9])
def test_bag_that_was_cut_is_replayed_as_far_as_it_goes(run_main, simulated, share):
    (file,) = [os.path.join(simulated, name) for name in os.listdir(simulated) if name.endswith(".mcap")]
    os.truncate(file, int(share * os.path.getsize(file)))
    status, output, errors = run_main("replay", simulated, "--json")
    result = json.loads(output)
    assert (status, result["reproduced"]) == (0, True)
    assert result["signals"]["interface_force"]["compared"] > 0.8 * share * 401
    assert errors.startswith("warning: ")


@pytest.mark.slow
def test_lockstep_bag_is_reproduced(run_main, composed_run):
    result = replayed(run_main, composed_run.told["bag"])
    assert result["reproduced"] is True
    assert result["signals"]["interface_force"]["compared"] > 0


@pytest.mark.slow
def test_real_time_bag_is_reproduced_with_the_measurements_that_the_estimator_missed(
    run_main, bmd_rths, tmp_path, domain
):
    """The estimator is stopped for a moment: of what came meanwhile, its queue holds the last ten measurements."""
    arguments = (*settings(ground_motion__duration=4.0, run__preflight="skip", **PATIENT), "--output", tmp_path)
    child = bmd_rths("run", CONFIG, *arguments, "--json")
    bag = wait_until(lambda: recorded(tmp_path, 150_000))
    (estimator,) = (pid for pid, command in processes_of_domain(domain).items() if "shear_estimator" in command)
    os.kill(estimator, signal.SIGSTOP)
    size = bag.stat().st_size
    try:
        wait_until(lambda: bag.stat().st_size > size + 100_000)
    finally:
        os.kill(estimator, signal.SIGCONT)
    run = child.wait()
    assert run.status == 0, run.errors
    record = read_bag(json.loads(run.output)["bag"])
    missed = np.isnan(record.interface_force) & ~np.isnan(record.applied_command)
    assert missed.sum() > 10
    assert len(record.timing.missed_steps) > 10
    result = replayed(run_main, bag.parent)
    assert result["reproduced"] is True
    told = result["signals"]["interface_force"]
    assert told["unknown_steps"] == []
    assert told["compared"] == (~np.isnan(record.interface_force)).sum()


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("--rate", "2"), "--rate, --wait-for: only possible with --ros"),
        (("--ros", "--set", "force_correction.gain=0.2"), "--ros, --set, --model: not together"),
        (("--ros", "--rate", "0"), "0.0 is not in the range x>0"),
        (("--set", "force_correction.gain=2"), "force_correction.gain: 2"),
        (("--set", "run.time_step=0.01"), "run.time_step: 0.01 s"),
        (("--model", "none.yaml"), "none.yaml: cannot be read"),
    ],
)
def test_wrong_usage_is_one_clear_line(run_main, simulated, arguments, problem):
    status, output, errors = run_main("replay", simulated, *arguments)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert problem in errors


def test_parameter_without_effect_is_told(run_main, simulated):
    status, output, errors = run_main("replay", simulated, "--set", "command_shaper.lead_time=0.015")
    assert status == 0
    assert errors == "warning: without effect in a replay: command_shaper.lead_time\n"
    assert "none, equal bit for bit" in output


# ---- onto ROS


@pytest.fixture
def nodes(simulated, start, tmp_path):
    """Start shear estimator and force correction with the configuration of the bag; in lockstep nothing gets lost."""
    config = config_from_mapping(read_bag(simulated).configuration).changed(run__record=False, run__lockstep=True)
    (tmp_path / "nodes.yaml").write_text(dump_config(config))
    return [
        start("-m", f"bmd_rths_nodes.nodes.{role}", "--ros-args", "--params-file", tmp_path / "nodes.yaml")
        for role in ("shear_estimator", "force_correction")
    ]


@pytest.mark.slow
def test_nodes_answer_a_playback_with_the_recorded_forces(bmd_rths, nodes, simulated, tmp_path):
    """Twice with the same processes. On a busy machine the shear of a step may come after the next required force.

    As slowly as here a node may be held up for a tenth of a second, and misses no measurement of the ten that wait.
    """
    for rate in ("0.5", "0.4"):
        how = ("--ros", "--rate", rate, "--output", tmp_path / rate, "--json")
        run = bmd_rths("replay", simulated, *how).wait()
        assert run.status == 0, run.errors
        result = json.loads(run.output)
        shear, corrected = (result["signals"][name] for name in FORCES)
        assert (shear["compared"], shear["differing"]) == (401, 0)
        assert corrected["differing"] == corrected["missing"] < 300
        assert corrected["largest"] == 0.0
        record = read_bag(result["output"])
        assert np.array_equal(record.interface_force, read_bag(simulated).interface_force)


@pytest.mark.slow
def test_no_step_is_published_before_its_time(run_main, monkeypatch):
    """100 steps of 5 ms at half the rate."""
    short = (*settings(ground_motion__duration=0.5), "--output", "short", "--json")
    bag = json.loads(run_main("simulate", CONFIG, *short)[1])["bag"]
    published = []
    play = Playback.play

    def timed(playback, rate, interrupts, progress):
        begin = time.perf_counter()
        play(playback, rate, interrupts, lambda steps: published.append(time.perf_counter() - begin) or progress(steps))

    monkeypatch.setattr(Playback, "play", timed)
    status, output, errors = run_main("replay", bag, "--ros", "--wait-for", "", "--rate", "0.5", "--json")
    assert status == 0, errors
    assert len(published) == 101
    assert all(when >= 0.01 * step for step, when in enumerate(published))
    assert json.loads(output)["signals"]["interface_force"]["missing"] == 101  # nobody answers


@pytest.mark.slow
def test_playback_is_refused_where_a_run_is_active_and_a_run_where_a_playback_is(
    bmd_rths, run_main, nodes, simulated, client
):
    first = bmd_rths("replay", simulated, "--ros", "--rate", "0.02")
    wait_until(lambda: client.count_publishers("/rths/measurement"))
    refused = (
        "error: another run is active on this ROS domain (bmd-rths on this computer); end it, or set ROS_DOMAIN_ID"
    )
    for arguments in (("replay", simulated, "--ros"), ("run", CONFIG, "--set", "run.preflight=skip")):
        status, _, errors = run_main(*arguments)
        assert (status, refused in errors) == (2, True), errors
    first.wait_for_words("playing 401 steps")  # both are refused before the nodes are ready, on a busy machine
    first.interrupt()
    ended = first.wait(30.0)
    told = [
        "waiting until shear_estimator, force_correction are ready (Ctrl-C ends)",
        "playing 401 steps, 100 s",
        "stopped",
    ]
    assert (ended.status, ended.errors.splitlines()) == (1, told)


@pytest.mark.slow
def test_playback_is_refused_where_somebody_publishes_what_it_would(run_main, simulated, client):
    """The lock of a domain is of one computer; the graph tells of the others."""
    publisher = client.create_publisher(AccelStamped, "/rths/ground_acceleration", 10)
    status, _, errors = run_main("replay", simulated, "--ros")
    client.destroy_publisher(publisher)
    told = "error: another run is active on this ROS domain (it publishes /rths/ground_acceleration); end it"
    assert status == 2
    assert errors.splitlines()[-1].startswith(told)


@pytest.mark.slow
def test_playback_without_nodes_ends_in_one_clear_line(run_main, simulated, monkeypatch):
    monkeypatch.setattr("bmd_rths_nodes.ros.playback.START_TIMEOUT", 0.5)
    status, output, errors = run_main("replay", simulated, "--ros", "--wait-for", "force_correction")
    assert (status, output, errors.count("\n")) == (1, "", 2)
    assert errors.splitlines()[1].startswith("error: not ready after 0.5 s: force_correction (silent)")
