"""`bmd-rths campaign`: every motion with every scheme and variation, in tables and files."""

import json
import re
from pathlib import Path

import pandas
import pytest
from pyarrow import parquet

from bmd_rths_nodes.campaign.results import PARQUET_NAME
from tests.nodes.conftest import CONFIG
from tests.nodes.small_campaign import AS_RECORDED, campaign, runs_of


@pytest.mark.slow
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


@pytest.mark.slow
def test_table_of_variations_has_a_row_a_record_and_variation_and_the_means(run_main, records):
    arguments = ("--motions", records, "--vary", "run.seed=1,2", "--vary", "safety.acceleration_limit=0.1,20.0")
    status, output, _ = run_main(*campaign(*arguments, "--schemes", "uc,plc", "--set", "safety.ramp_acceleration=0.1"))
    assert status == 0
    lines = [line for line in output.splitlines() if "run.seed=2, safety.acceleration_limit=20.0" in line]
    assert [line.split()[1] for line in lines] == ["kobe", "other", "mean"] * 2
    assert "2 limit" in output
    assert "unstable" not in output.replace("(unstable)", "")


@pytest.mark.slow
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


@pytest.mark.slow
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


def test_parquet_has_the_same_runs(run_main, records):
    _, output, _ = run_main(*campaign("--motions", records, "--json"))
    table = parquet.read_table(f"out/{PARQUET_NAME}").to_pylist()
    errors = [run["rmse_percent"]["substructure"] for run in runs_of(output)]
    assert sorted(row["rmse_substructure_percent"] for row in table) == sorted(errors)


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
