"""`bmd-rths motions`, and components of records on the command line."""

import json

import pytest

from tests.core.record_samples import SAMPLES, TIME_STEP
from tests.nodes.conftest import CONFIG


@pytest.fixture
def folder(tmp_path):
    records = tmp_path / "records"
    (records / "event").mkdir(parents=True)
    (records / "event" / "a.V2A").write_bytes(SAMPLES["GeoNet V2A"].content)
    (records / "b.json").write_bytes(SAMPLES["SimCenter JSON"].content)
    (records / "README.md").write_text("[bold]Records[/bold]\n")
    return records


def test_motions_lists_components_and_problems(run_main, folder):
    status, output, errors = run_main("motions", folder, "--json")
    assert (status, errors) == (0, "")
    result = json.loads(output)
    assert [(record["file"], record["component"]) for record in result["records"]] == [
        ("b.json", "x"),
        ("b.json", "y"),
        ("b.json", "z"),
        ("event/a.V2A", "N10E"),
        ("event/a.V2A", "S80E"),
        ("event/a.V2A", "Up"),
    ]
    record = result["records"][4]
    assert (record["format"], record["points"], record["time_step_s"]) == ("GeoNet V2A", 24, TIME_STEP)
    assert record["duration_s"] == pytest.approx(23 * TIME_STEP)
    assert record["pga_m_s2"] == pytest.approx(2.0)
    assert record["pgv_m_s"] > 0.0
    assert record["arias_intensity_m_s"] > 0.0
    assert 0.0 < record["significant_duration_s"] < record["duration_s"]
    without_unit = result["records"][0]
    assert (without_unit["states_unit"], without_unit["pga_m_s2"], without_unit["pgv_m_s"]) == (False, None, None)
    assert without_unit["dominant_frequency_hz"] == result["records"][3]["dominant_frequency_hz"]
    ((file, problem),) = ((entry["file"], entry["problem"]) for entry in result["not_read"])
    assert file == "README.md"
    assert problem.startswith("not a ground motion in a format that is read")


def test_motions_shows_a_table(run_main, folder):
    status, output, _ = run_main("motions", folder)
    assert status == 0
    heading, *rows = output.splitlines()
    assert heading.split("  ")[0] == "file"
    assert "PGA [m/s²]" in heading
    assert "D5-95 [s]" in heading
    assert sum(row.startswith("event/a.V2A  GeoNet V2A") for row in rows) == 3
    assert "not read: README.md: not a ground motion" in output
    assert "ground_motion.unit" in output


def test_motions_of_one_file(run_main, folder):
    _, output, _ = run_main("motions", folder / "event" / "a.V2A", "--json")
    assert {record["file"] for record in json.loads(output)["records"]} == {"a.V2A"}


def test_motions_of_no_folder_is_refused(run_main, tmp_path):
    status, output, errors = run_main("motions", tmp_path / "none")
    assert (status, output) == (2, "")
    assert errors == f"error: '{tmp_path / 'none'}': no such folder\n"


def test_simulate_takes_one_component(run_main, folder):
    arguments = ("simulate", CONFIG, "--motion", folder / "event" / "a.V2A")
    status, output, errors = run_main(*arguments, "--json")
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert "3 components; ground_motion.component (--component) must be one of 'N10E', 'S80E', 'Up'" in errors
    status, output, _ = run_main(*arguments, "--component", "s80e", "--json")
    assert status == 0
    assert json.loads(output)["motion"] == "a_S80E"


def test_simulate_takes_the_unit_of_a_file_without_one(run_main, folder):
    arguments = ("simulate", CONFIG, "--motion", folder / "b.json", "--component", "x", "--json")
    status, _, errors = run_main(*arguments)
    assert (status, errors.count("\n")) == (2, 1)
    assert "ground_motion.unit must give it: g, m/s2, cm/s2 or gal" in errors
    status, _, _ = run_main(*arguments, "--set", "ground_motion.unit=gal")
    assert status == 0


def test_folder_without_ground_motions_is_told_in_words(run_main, tmp_path):
    (tmp_path / "records").mkdir()
    status, output, _ = run_main("motions", tmp_path / "records")
    assert (status, output) == (0, f"no ground motion was found in {tmp_path / 'records'}\n")


def test_motions_tells_how_a_configuration_runs_them(run_main, tmp_path):
    """A record of 2 m/s² in steps of 0.01 s is scaled by a half; one whose steps do not divide cannot be run."""
    (tmp_path / "records").mkdir()
    for name, step in (("good", 0.01), ("odd", 0.0073)):
        rows = [f"{k * step:.6f},{2.0 * (-1) ** k:.3f}" for k in range(200)]
        (tmp_path / "records" / f"{name}.csv").write_text("\n".join(["time [s],acceleration [m/s2]", *rows]) + "\n")
    status, output, errors = run_main("motions", tmp_path / "records", "--as-run", CONFIG, "--json")
    assert status == 0, errors
    good, odd = json.loads(output)["records"]
    assert good["scale_factor"] == pytest.approx(0.5, rel=0.2)
    assert good["as_run_pga_m_s2"] == 1.0
    assert good["as_run_pgd_m"] > 0.0
    assert odd["scale_factor"] is None
    _, output, _ = run_main("motions", tmp_path / "records", "--as-run", CONFIG)
    assert "PGD run [m]" in output
