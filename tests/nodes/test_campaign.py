"""`bmd-rths campaign`: every run once, whatever stops it; and many bags in one table."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from random import Random

import distributed
import pandas
import pytest
from pyarrow import parquet

from bmd_rths_core.campaign.motions import read_motions
from bmd_rths_core.campaign.study import Study
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.campaign.pool import PieceRunner, in_process, in_processes, on_cluster
from bmd_rths_nodes.campaign.results import CSV_NAME, PARQUET_NAME, CampaignResults
from tests.nodes.conftest import CONFIG

MOTION = "time_s,acceleration_g\n" + "".join(f"{0.01 * i:.2f},{{}}\n" for i in range(80))


@pytest.fixture
def records(tmp_path):
    folder = tmp_path / "records"
    folder.mkdir()
    for name, factor in (("kobe", 1), ("other", -2)):
        values = [f"{factor * (i % 20 - 10) / 100:.3f}" for i in range(80)]
        (folder / f"{name}.csv").write_text(MOTION.format(*values))
    (folder / "README.md").write_text("Records\n")
    return folder


@pytest.fixture
def study(records):
    return Study(Config(), read_motions(records).motions, ["uc", "plc"], {"run.seed": [0, 1]})


#: The saw teeth of the records pass a limit when they come twice as fast.
AS_RECORDED = ("--set", "ground_motion.time_scale=1.0")


def campaign(*arguments):
    return ("campaign", CONFIG, *AS_RECORDED, "--jobs", 1, "--output", "out", *arguments)


def csv_text():
    return Path("out", CSV_NAME).read_text()


def runs_of(output):
    return json.loads(output)["runs"]


def test_campaign_runs_every_motion_and_scheme(run_main, records):
    status, output, errors = run_main(*campaign("--motions", records, "--json"))
    assert status == 0
    assert errors == "left out: README.md: not a ground motion in a format that is read: " + errors.split("read: ")[1]
    result = json.loads(output)
    assert set(result["left_out"]) == {"README.md"}
    runs = result["runs"]
    assert [(run["scheme"], run["motion"]) for run in runs] == [
        (scheme, motion) for scheme in ("uc", "fc", "plc", "plc_fc") for motion in ("kobe", "other")
    ]
    for run in runs:
        assert set(run["rmse_percent"]) == {"substructure", "control_layer", "superstructure"}
        assert (run["stable"], run["outcome"], run["engine"]) == (True, "finished", "linear")
        status, alone, _ = run_main(
            *("simulate", CONFIG, *AS_RECORDED, "--scheme", run["scheme"], "--motion", run["file"], "--json"),
        )
        assert json.loads(alone)["rmse_percent"] == pytest.approx(run["rmse_percent"], rel=1e-9)


def test_configuration_may_be_left_out(run_main, records, monkeypatch):
    monkeypatch.setattr("bmd_rths_nodes.cli.configuration.installed_configs", lambda: {"simplified_bmd": CONFIG})
    status, output, _ = run_main("campaign", "--jobs", 1, "--motions", records, "--schemes", "uc", "--json")
    assert (status, len(runs_of(output))) == (0, 2)


def test_tables_stand_beside_those_of_the_paper(run_main, records):
    status, output, _ = run_main(*campaign("--motions", records))
    assert status == 0
    for text in ("Table 2, substructure", "Table 3, superstructure", "plc_fc (paper)", "(89.36)", "(59.41)", "(90.24)"):
        assert text in output
    assert "virtual laboratory" in output
    assert "│ other" in output


def test_table_of_variations_has_a_row_a_record_and_variation_and_the_means(run_main, records):
    arguments = ("--motions", records, "--vary", "run.seed=1,2", "--vary", "safety.acceleration_limit=0.1,20.0")
    status, output, _ = run_main(*campaign(*arguments, "--schemes", "uc,plc", "--set", "safety.ramp_acceleration=0.1"))
    assert status == 0
    lines = [line for line in output.splitlines() if "run.seed=2, safety.acceleration_limit=20.0" in line]
    assert [line.split()[1] for line in lines] == ["kobe", "other", "mean"] * 2
    assert "2 limit" in output
    assert "unstable" not in output.replace("(unstable)", "")


@pytest.mark.parametrize("columns", [40, 60, 200])
def test_table_shows_every_row_at_any_width(run_main, records, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
    status, output, _ = run_main(*campaign("--motions", records, "--vary", "run.seed=1,2", "--schemes", "uc,plc_fc"))
    assert status == 0
    plain = re.sub(r"\x1b\[[0-9;]*m", "", output)
    tables = plain.partition("RMSE of Eq. 12")[0].splitlines()
    assert max(len(line) for line in tables) <= columns
    text = "".join(re.sub(r"[^\w.=%]", "", plain))
    for row in runs_of(run_main(*campaign("--motions", records, "--vary", "run.seed=1,2", "--json"))[1]):
        if row["scheme"] in ("uc", "plc_fc"):
            assert f"{row['rmse_percent']['substructure']:.2f}" in text


def test_paper_stands_beside_its_own_system_only(run_main, records):
    heavier = ("--set", "specimen.masses=[5500.0,3500.0]")
    for arguments in (heavier, ("--vary", "force_correction.feedback_scale=0.5,0.6")):
        status, output, _ = run_main(*campaign("--motions", records, "--schemes", "uc", *arguments))
        assert status == 0
        assert "RMSE, substructure" in output
        assert "paper" not in output
        assert "Table 2" not in output


def test_study_file_has_a_column_for_each_varied_parameter(run_main, records):
    vary = ("--vary", "run.seed=1,2", "--vary", "specimen.masses=[5200.0,3200.0],[5000.0,3000.0]")
    arguments = (*vary, "--schemes", "uc,plc", "--margins")
    status, output, _ = run_main(*campaign("--motions", records, *arguments, "--json"))
    assert status == 0
    frame = pandas.read_csv("out/study.csv")
    runs = runs_of(output)
    assert len(frame) == len(runs) == 16
    assert frame["run.seed"].tolist() == [run["variation"]["run.seed"] for run in runs]
    assert [json.loads(cell) for cell in frame["specimen.masses"]] == [r["variation"]["specimen.masses"] for r in runs]
    assert frame["stability"].unique().tolist() == ["stable"]
    for column, of in (("J1", "J1"), ("J9", "J9")):
        assert frame[column].tolist() == pytest.approx([run["criteria"][of] for run in runs], rel=1e-14)
    assert frame["peak_drift_1"].tolist() == pytest.approx([run["peak_drifts"][0] for run in runs], rel=1e-14)
    assert set(frame["rmse_superstructure_percent"].isna()) == {False}
    # One margin for each loop, as `stability` tells it.
    assert frame.groupby(["scheme", "specimen.masses"])["gain_margin"].nunique().tolist() == [1] * 4
    assert frame["gain_margin"].nunique() == 4
    scale = frame["mass_ratio"] / (1.0 - frame["mass_ratio"])
    allowed = frame["allowable_mass_ratio"] / (1.0 - frame["allowable_mass_ratio"])
    assert (allowed / scale).tolist() == pytest.approx(frame["gain_margin"].tolist())
    # Nothing is run again, and the file is of the last command.
    run_main(*campaign("--motions", records, "--schemes", "uc", "--vary", "run.seed=1"))
    assert list(pandas.read_csv("out/study.csv")["run.seed"]) == [1, 1]


@pytest.mark.slow
def test_plots_are_drawn_of_numbers_that_were_varied(run_main, records):
    vary = (
        "--vary",
        "run.seed=1,2",
        "--vary",
        "force_correction.gain=0.2,0.4",
        "--vary",
        "safety.force_action=ramp,hold",
    )
    status, output, _ = run_main(*campaign("--motions", records, "--schemes", "plc,fc", *vary, "--plots"))
    assert status == 0
    names = ["schemes", "over_run.seed", "over_force_correction.gain"]
    names += [f"map_run.seed_force_correction.gain_{scheme}" for scheme in ("plc", "fc")]
    drawn = [f"out/plots/{name}.{ending}" for name in names for ending in ("pdf", "svg")]
    assert [line.removeprefix("plot: ") for line in output.splitlines() if line.startswith("plot: ")] == drawn
    for path in map(Path, drawn):
        assert path.read_bytes().startswith(b"%PDF" if path.suffix == ".pdf" else b"<?xml")
        assert b"/Type3" not in path.read_bytes()


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
def test_processes_give_the_same_results_in_any_order(study):
    run = PieceRunner(None)
    expected = [result for piece in in_process(study.pieces(), run) for result in piece]
    found = [result for piece in in_processes(study.pieces(), run, jobs=2) for result in piece]
    assert sorted(found, key=lambda r: r["key"]) == sorted(expected, key=lambda r: r["key"])


@pytest.mark.slow
def test_cluster_gives_the_same_results(study):
    expected = [result for piece in in_process(study.pieces(), PieceRunner(None)) for result in piece]
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        found = [r for piece in on_cluster(study.pieces(), PieceRunner(None), cluster.scheduler_address) for r in piece]
    assert sorted(found, key=lambda r: r["key"]) == sorted(expected, key=lambda r: r["key"])


def test_cluster_without_distributed_is_one_clear_line(study, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="distributed is not installed"):
        next(on_cluster(study.pieces(), PieceRunner(None), "tcp://127.0.0.1:1"))


def test_parquet_has_the_same_runs(run_main, records):
    _, output, _ = run_main(*campaign("--motions", records, "--json"))
    table = parquet.read_table(f"out/{PARQUET_NAME}").to_pylist()
    errors = [run["rmse_percent"]["substructure"] for run in runs_of(output)]
    assert sorted(row["rmse_substructure_percent"] for row in table) == sorted(errors)


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
        # Runs beside others and alone differ by rounding.
        assert run.pop("rmse_percent") == pytest.approx(expected.pop("rmse_percent"), rel=1e-12)
        assert run.pop("tracking_delay_ms") == pytest.approx(expected.pop("tracking_delay_ms"), rel=1e-9)
        assert run == expected


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


def test_killed_process_ends_the_study_in_one_clear_line(run_main, records, monkeypatch):
    def broken(pieces, run, jobs):
        raise BrokenProcessPool

    monkeypatch.setattr("bmd_rths_nodes.campaign.pool.in_processes", broken)
    status, output, errors = run_main("campaign", CONFIG, "--jobs", 2, "--output", "out", "--motions", records)
    assert (status, output) == (1, "")
    assert errors.splitlines()[-1].startswith("error: a process of the campaign was killed")


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


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--motions", "none"], "none"),
        (["--motions", "records", "--schemes", "uc,best"], "--schemes uc,best: 'best' is unknown"),
        (["--motions", "records", "--vary", "run.seed"], "--vary run.seed: SECTION.KEY=A,B,C is required"),
        (["--motions", "records", "--vary", "run.seed="], "--vary run.seed=: SECTION.KEY=A,B,C is required"),
        (["--motions", "records", "--vary", "run.seed=[1"], "is not a list of YAML values"),
        (["--motions", "records", "--vary", "run.seed=-1"], "--vary run.seed=-1: run.seed"),
        (["--motions", "records", "--scheduler", "tcp://x:1"], "--jobs, --scheduler: only one"),
        (["--motions", "records", "--output", "records/kobe.csv/out"], "cannot be written"),
    ],
)
def test_wrong_usage_is_one_clear_line(run_main, records, arguments, problem):
    status, output, errors = run_main(*campaign(*arguments))
    assert (status, output) == (2, "")
    assert problem in errors.splitlines()[-1]
    assert "Traceback" not in errors


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
