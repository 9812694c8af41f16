"""The pre-flight of `bmd-rths run`: what must not be run is refused before anything is started or written."""

import json

import pytest

from bmd_rths_msgs_py.bag_reader import read_bag
from tests.nodes.conftest import CONFIG, EIGHT_STORY, processes_of_domain


def test_no_go_is_refused_in_one_line_and_nothing_is_written(bmd_rths, tmp_path, domain):
    result = bmd_rths("run", EIGHT_STORY, "--output", tmp_path / "bags").wait()
    assert (result.status, result.output) == (2, "")
    errors = result.errors
    assert errors.startswith("error: pre-flight: NO-GO: mass ratio 0.650 is above the allowable")
    assert "safety.stability_limit [1] passed at step 76" in errors
    assert "--override-preflight" in errors
    assert errors.count("\n") == 1
    assert not (tmp_path / "bags").exists()
    assert processes_of_domain(domain) == {}


@pytest.mark.slow
def test_overridden_preflight_is_told_and_recorded(bmd_rths, tmp_path):
    folder = tmp_path / "bags"
    options = ("--override-preflight", "--lockstep", "--composed", "--output", folder, "--json")
    result = bmd_rths("run", EIGHT_STORY, *options).wait()
    assert result.status == 1
    told = json.loads(result.output)
    assert told["outcome"] == "limit"
    assert told["preflight"]["cleared"] is False
    assert told["preflight"]["problems"][0].startswith("NO-GO")
    assert told["preflight"]["stability_indicator"] > 0.7
    assert "; OVERRIDDEN: NO-GO" in result.errors
    assert read_bag(told["bag"]).configuration["run"]["preflight"] == "override"


@pytest.mark.slow
def test_cleared_preflight_tells_the_peaks_beside_their_limits(composed_run):
    assert "predicted for the simulated table: displacement" in composed_run.errors
    assert " of 230 mm, velocity " in composed_run.errors
    assert "OVERRIDDEN" not in composed_run.errors


@pytest.mark.slow
def test_skipped_preflight_predicts_nothing(bmd_rths, tmp_path):
    options = ("--lockstep", "--composed", "--set", "ground_motion.duration=1.0", "--set", "run.preflight=skip")
    result = bmd_rths("run", CONFIG, *options, "--output", tmp_path / "bags", "--json").wait()
    assert result.status == 0
    assert json.loads(result.output)["preflight"] is None
    assert "predicted" not in result.errors
