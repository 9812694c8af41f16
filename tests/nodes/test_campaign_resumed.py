"""A campaign runs everything once, whatever stops it, and nobody else writes its file."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from random import Random

import pytest

from bmd_rths_nodes.campaign.results import CSV_NAME, CampaignResults
from tests.nodes.conftest import CONFIG
from tests.nodes.small_campaign import campaign, csv_text, runs_of


def test_study_that_ran_before_is_not_run_again(run_main, records, monkeypatch):
    arguments = campaign("--motions", records, "--vary", "run.seed=0,1")
    _, first, _ = run_main(*arguments, "--schemes", "uc", "--json")
    lines = csv_text()
    _, more, _ = run_main(*arguments, "--schemes", "uc,plc", "--json")
    assert csv_text().startswith(lines)
    assert len(csv_text().splitlines()) == 1 + 8

    def not_again(piece):
        raise AssertionError(piece)

    monkeypatch.setattr("bmd_rths_nodes.campaign.pool.run_piece", not_again)
    _, again, errors = run_main(*arguments, "--schemes", "uc,plc", "--json")
    assert again == more
    assert errors.endswith("8 of 8 runs were in out/campaign.csv already\n")
    assert [run for run in runs_of(more) if run["scheme"] == "uc"] == runs_of(first)


def test_cut_line_is_dropped_and_run_again(run_main, records):
    arguments = campaign("--motions", records, "--json")
    _, whole, _ = run_main(*arguments)
    with open("out/campaign.csv", "r+b") as file:
        file.truncate(len(file.read()) - 30)
    _, again, _ = run_main(*arguments)
    assert runs_of(again)[:-1] == runs_of(whole)[:-1]
    # A run alone and one beside others differ by rounding.
    assert runs_of(again)[-1]["rmse_percent"] == pytest.approx(runs_of(whole)[-1]["rmse_percent"], rel=1e-12)
    assert len(csv_text().splitlines()) == 1 + 8


@pytest.mark.slow
def test_killed_study_goes_on_and_leaves_no_process(records, tmp_path):
    """SIGKILL in the middle: what was written stays, nothing is run twice, and the workers end too."""
    values = ",".join(str(i) for i in range(30))
    command = [sys.executable, "-m", "bmd_rths_nodes.cli.main", "campaign", str(CONFIG), "--motions", str(records)]
    command += ["--output", str(tmp_path / "out"), "--jobs", "2", "--json", "--vary", f"run.seed={values}"]
    results = tmp_path / "out" / CSV_NAME
    with open(tmp_path / "errors.txt", "wb") as errors:
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, start_new_session=True
        )
        try:
            _wait_until(lambda: results.exists() and results.read_bytes().count(b"\n") > 20, child)
        finally:
            os.kill(child.pid, signal.SIGKILL)
            child.wait()
    before = results.read_bytes()
    whole = before[: before.rindex(b"\n") + 1]
    assert 20 < whole.count(b"\n") < 241
    _wait_until(lambda: not _session(child.pid))
    finished = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=300)
    assert finished.returncode == 0, finished.stderr
    after = results.read_bytes()
    assert after.startswith(whole)
    keys = [line.partition(b",")[0] for line in after.splitlines()[1:]]
    assert len(keys) == len(set(keys)) == 240
    assert len(json.loads(finished.stdout)["runs"]) == 240


@pytest.mark.slow
def test_study_killed_at_random_times_gives_what_an_uninterrupted_one_gives(run_main, bmd_rths, records, tmp_path):
    """Three times SIGKILL, each after some more results; the last command finds every run once."""
    values = ",".join(str(i) for i in range(16))
    arguments = ("--motions", records, "--vary", f"run.seed={values}", "--schemes", "uc,plc_fc", "--json")
    killed = ["campaign", CONFIG, *arguments, "--jobs", 1, "--output", tmp_path / "killed"]
    results = tmp_path / "killed" / CSV_NAME
    random = Random(5)
    size = 0
    for _ in range(3):
        size += random.randrange(1, 3000)
        child = bmd_rths(*killed)
        _wait_until(lambda size=size: results.exists() and results.stat().st_size > size, child.process)
        child.process.kill()
        child.process.wait()
        size = results.stat().st_size
    status, resumed, _ = run_main(*killed)
    assert status == 0
    assert len(results.read_text().splitlines()) == 1 + 64
    _, whole, _ = run_main("campaign", CONFIG, *arguments, "--jobs", 1, "--output", "whole")
    for run, expected in zip(runs_of(resumed), runs_of(whole), strict=True):
        # Runs beside others and alone differ by rounding, in whatever is a number.
        assert run.pop("rmse_percent") == pytest.approx(expected.pop("rmse_percent"), rel=1e-12)
        assert run.pop("tracking_delay_ms") == pytest.approx(expected.pop("tracking_delay_ms"), rel=1e-9)
        numbers = [name for name, value in expected.items() if isinstance(value, float)]
        assert [run.pop(name) for name in numbers] == pytest.approx([expected.pop(name) for name in numbers], rel=1e-12)
        assert run == expected


def _session(leader):
    """Return the processes of a session."""
    found = []
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            if os.getsid(int(name)) == leader:
                found.append(int(name))
        except ProcessLookupError:
            continue
    return found


def _wait_until(condition, child=None, timeout=120.0):
    end = time.monotonic() + timeout
    while not condition():
        assert child is None or child.poll() is None, "the study has ended by itself"
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def test_killed_process_ends_the_study_in_one_clear_line(run_main, records, monkeypatch):
    def broken(pieces, run, jobs):
        raise BrokenProcessPool

    monkeypatch.setattr("bmd_rths_nodes.campaign.pool.in_processes", broken)
    status, output, errors = run_main("campaign", CONFIG, "--jobs", 2, "--output", "out", "--motions", records)
    assert (status, output) == (1, "")
    assert errors.splitlines()[-1].startswith("error: a process of the campaign was killed")


def test_results_of_something_else_are_refused(run_main, records, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / CSV_NAME).write_text("a,b\n1,2\n")
    status, _, errors = run_main(*campaign("--motions", records))
    assert status == 2
    assert "campaign.csv: line 1: not the columns of a campaign" in errors
    assert (tmp_path / "out" / CSV_NAME).read_text() == "a,b\n1,2\n"


def test_two_campaigns_do_not_write_the_same_file(run_main, records, tmp_path):
    (tmp_path / "out").mkdir()
    other = CampaignResults(tmp_path / "out")
    status, _, errors = run_main(*campaign("--motions", records))
    other.close()
    assert status == 2
    assert "another campaign writes it" in errors
