"""Many bags in one table: those of a campaign, of single runs, and of the ROS graph."""

import json
import os
from pathlib import Path

import pytest

from bmd_rths_msgs_py.bag_reader import read_bag
from tests.nodes.conftest import CONFIG
from tests.nodes.small_campaign import AS_RECORDED, campaign, csv_text, runs_of


@pytest.mark.slow
def test_bags_are_named_with_what_differs(run_main):
    short = ("--set", "ground_motion.duration=1.0", "--output", "bags", "--json")
    for changes in ((), ("--set", "force_correction.gain=0.3"), ("--scheme", "uc")):
        run_main("simulate", CONFIG, *short, *changes)
    bags = sorted(Path("bags").iterdir())
    status, output, _ = run_main("analyze", *bags, "--json")
    runs = {Path(run["bag"]).name: run for run in runs_of(output)}
    assert status == 0
    assert [run["differs"] for run in runs.values()] == [
        {"force_correction.gain": gain} for gain in [run["variation"]["force_correction.gain"] for run in runs.values()]
    ]
    assert sorted(run["differs"]["force_correction.gain"] for run in runs.values()) == [0.3, 0.5, 0.5]
    _, table, _ = run_main("analyze", *bags)
    assert all(name in table for name in runs)
    assert "force_correction.gain=0.3" in table


def test_bags_are_those_of_single_runs_and_are_made_up_for(run_main, records):
    arguments = campaign("--motions", records, "--schemes", "plc_fc", "--json")
    run_main(*arguments)
    status, output, _ = run_main(*arguments, "--bags")
    assert status == 0
    assert len(csv_text().splitlines()) == 1 + 2
    bags = [run["bag"] for run in runs_of(output)]
    for run in runs_of(output):
        record = read_bag(run["bag"])
        assert (record.outcome, record.steps) == (run["outcome"], run["steps"])
    assert sorted(os.listdir("out/bags")) == sorted(os.path.basename(bag) for bag in bags)
    status, analysed, _ = run_main("analyze", *bags, "--json")
    for run, again in zip(runs_of(output), runs_of(analysed), strict=True):
        assert again["rmse_percent"] == pytest.approx(run["rmse_percent"], rel=1e-9)
        assert (again["motion"], again["scheme"], again["event"]) == (run["motion"], run["scheme"], run["event"])
    _, table, _ = run_main("analyze", *bags)
    _, expected, _ = run_main(*campaign("--motions", records, "--schemes", "plc_fc"))
    assert table.startswith("Bags")
    assert table.endswith(expected.partition("results: ")[0])
    assert [name for name in os.listdir("out/bags") if name not in table.replace("\n", "")] == []


@pytest.mark.slow
def test_lockstep_bags_give_the_tables_of_the_campaign(run_main, records):
    """With the noise of the same seed: every digit that is shown.

    Two of the bags come from the ROS graph. For the others `simulate` stands in, which is the same bit for bit with
    every scheme (test_run.py).
    """
    runs = [(scheme, file) for scheme in ("uc", "fc", "plc", "plc_fc") for file in sorted(records.glob("*.csv"))]
    started = {run: _lockstep_bag(run_main, *run) for run in (runs[0], runs[-1])}
    bags = [started[run] if run in started else _simulated_bag(run_main, *run) for run in runs]
    status, from_bags, _ = run_main("analyze", *bags)
    assert status == 0
    _, expected, _ = run_main(*campaign("--motions", records))
    assert from_bags.endswith(expected.partition("results: ")[0])
    _, output, _ = run_main("analyze", *bags, "--json")
    _, simulated, _ = run_main(*campaign("--motions", records, "--json"))
    for ours, theirs in zip(runs_of(output), runs_of(simulated), strict=True):
        assert ours["rmse_percent"] == pytest.approx(theirs["rmse_percent"], rel=1e-9)


def _options(scheme, record):
    return ("--scheme", scheme, "--motion", record, *AS_RECORDED, "--json")


def _lockstep_bag(run_main, scheme, record):
    """Return the bag of a run on the ROS graph."""
    how = ("--lockstep", "--composed", "--set", "run.preflight=skip")
    status, output, errors = run_main("run", CONFIG, *_options(scheme, record), *how)
    assert status == 0, errors
    return json.loads(output)["bag"]


def _simulated_bag(run_main, scheme, record):
    """Return the bag of a run in process."""
    status, output, errors = run_main("simulate", CONFIG, *_options(scheme, record), "--output", "simulated")
    assert status == 0, errors
    return json.loads(output)["bag"]
