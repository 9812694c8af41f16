"""``bmd-rths robustness`` and the quality of a run on the command line."""

import csv
import json
from pathlib import Path

import pytest

CONFIG = Path(__file__).parents[2] / "config" / "simplified_bmd.yaml"
SHORT = ("--set", "ground_motion.duration=3.0")


def test_study_is_told_and_goes_on_where_it_was(run_main):
    few = ("robustness", CONFIG, *SHORT, "--schemes", "uc", "--jobs", "1", "--json")
    status, output, errors = run_main(*few, "--plants", "1")
    assert (status, errors) == (0, "")
    assert json.loads(output)["schemes"]["uc"]["runs"] == 1
    status, output, errors = run_main(*few, "--plants", "2")
    assert (status, errors) == (0, "1 of 2 runs were in robustness/campaign.csv already\n")
    told = json.loads(output)["schemes"]["uc"]
    with open("robustness/campaign.csv") as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == told["runs"] == 2
    worst = max(float(line["rmse_true_substructure_percent"]) for line in lines)
    assert told["substructure_percent"]["worst"] == pytest.approx(worst)
    assert told["capture_substructure"]["worst"] == pytest.approx(min(float(e["capture_substructure"]) for e in lines))
    status, output, _ = run_main(*few[:-1], "--plants", "2")
    assert status == 0
    assert "uc, of 2 none unstable" in output


def test_wrong_share_and_scheme_are_refused(run_main):
    assert run_main("robustness", CONFIG, "--share", "1.5")[::2] == (
        2,
        "error: --share 1.5: is not allowed; >= 0 and < 1 is required\n",
    )
    status, _, errors = run_main("robustness", CONFIG, "--schemes", "none")
    assert status == 2
    assert "'none' is unknown" in errors


def test_simulate_tells_the_quality_of_a_run(run_main):
    status, output, _ = run_main("simulate", CONFIG, *SHORT, "--json")
    assert status == 0
    result = json.loads(output)
    keys = {"substructure", "control_layer", "superstructure"}
    for name in ("rmse_percent", "rmse_true_percent", "rmse_clean_percent", "noise_floor_percent"):
        assert set(result[name]) == keys
    assert result["noise_floor_percent"]["substructure"] is None
    assert set(result["capture"]) == {"substructure", "superstructure"}
    assert result["verdict"] == "red"
    assert result["tracking_error_percent"] > 20.0
    assert any("tracking error" in reason for reason in result["verdict_reasons"])
    _, output, _ = run_main("simulate", CONFIG, *SHORT, "--no-capture", "--json")
    assert json.loads(output)["capture"] == {"substructure": None, "superstructure": None}
