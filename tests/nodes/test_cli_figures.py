"""`bmd-rths figures`: files and numbers, and one clear line with exit status 2 for everything that is wrong."""

import json
import subprocess
import sys

import pytest

from bmd_rths_nodes.cli.main import main
from tests.nodes.conftest import CONFIG

EIGHT_STORY = CONFIG.with_name("eight_story_bmd.yaml")


@pytest.fixture
def run_main(monkeypatch, capsys, tmp_path):
    """Run the command line in this process, in an empty folder; return status, standard output and error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["bmd-rths", "figures", *(str(argument) for argument in arguments)])
        status = main()
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.mark.slow
def test_figures_of_both_systems_with_their_numbers(run_main, tmp_path):
    status, output, _ = run_main(CONFIG, EIGHT_STORY, "--only", "10,7", "--format", "svg", "--json")
    assert status == 0
    of_simplified, of_eight_story = json.loads(output)["figures"]
    assert (of_simplified["number"], of_eight_story["number"]) == (10, 7)
    assert of_eight_story["files"] == ["figures/figure_7.svg"]
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"figure_7.svg", "figure_10.svg"}
    values = {entry["quantity"]: entry for entry in of_eight_story["comparisons"]}
    assert round(values["margin, Eq. 9, all modes"]["value"], 4) == 0.1430
    assert values["margin, Eq. 9, all modes"]["paper"] == "around 0.15"


@pytest.mark.slow
def test_table_for_a_person(run_main, tmp_path):
    status, output, _ = run_main(EIGHT_STORY, "--only", "8", "--output", "out")
    assert status == 0
    for text in ("0.739", "very close", "written: out/figure_8.png out/figure_8.svg"):
        assert text in output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"figure_8.png", "figure_8.svg"}


@pytest.mark.slow
def test_installed_configurations_are_the_default(run_main, monkeypatch, tmp_path):
    share = tmp_path / "prefix" / "share"
    (share / "ament_index/resource_index/packages").mkdir(parents=True)
    (share / "ament_index/resource_index/packages/bmd_rths_nodes").write_text("")
    (share / "bmd_rths_nodes/config").mkdir(parents=True)
    for config in (CONFIG, EIGHT_STORY):
        (share / "bmd_rths_nodes/config" / config.name).write_text(config.read_text())
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    status, output, errors = run_main("--only", "8,13", "--format", "svg", "--json")
    assert status == 0, errors
    assert [figure["number"] for figure in json.loads(output)["figures"]] == [8, 13]


@pytest.mark.slow
def test_a_test_that_was_stopped_has_status_1(run_main, tmp_path):
    stopped = CONFIG.read_text().replace(
        "acceleration_limit: 20.0", "acceleration_limit: 1.0\n      ramp_acceleration: 1.0"
    )
    (tmp_path / "stopped.yaml").write_text(stopped)
    status, _, errors = run_main("stopped.yaml", "--only", "13", "--format", "png")
    assert status == 1
    assert "Figure 13: the test was stopped: safety.acceleration_limit" in errors
    assert (tmp_path / "figures" / "figure_13.png").is_file()


#: What is wrong: the arguments, and what the one line must name.
WRONG = {
    "unknown figure": ([CONFIG, "--only", "9"], ["--only 9", "10,11,13"]),
    "figure of the other system": ([CONFIG, "--only", "11,7"], ["--only 11,7", "'7'", "10,11,13"]),
    "no number": ([CONFIG, "--only", "all"], ["--only all"]),
    "unknown format": ([CONFIG, "--format", "png,pdf"], ["--format png,pdf", "'pdf'", "png,svg"]),
    "missing record": ([CONFIG, "--motion", "no.at2"], ["no.at2", "No such file"]),
    "record without its figure": ([CONFIG, "--motion", "no.at2", "--only", "11"], ["--motion no.at2", "Figure 13"]),
    "one system twice": ([CONFIG, CONFIG], [CONFIG.name, "second configuration of the simplified BMD"]),
    "system of no paper": (["other.yaml"], ["other.yaml", "133.1 rad/s", "94.09 rad/s"]),
    "missing configuration": (["none.yaml"], ["none.yaml", "No such file"]),
    "limit below the excitation": (["tight.yaml", "--only", "10"], ["safety.acceleration_limit", "identification run"]),
    "unwritable output": ([CONFIG, "--output", "a_file/out"], ["a_file/out", "cannot be written"]),
}


@pytest.mark.parametrize("case", WRONG.values(), ids=WRONG)
def test_wrong_input_has_status_2_and_one_clear_line_and_nothing_is_written(run_main, tmp_path, case):
    arguments, named = case
    (tmp_path / "other.yaml").write_text(CONFIG.read_text().replace("masses: [8000.0]", "masses: [4000.0]"))
    (tmp_path / "tight.yaml").write_text(
        CONFIG.read_text().replace("acceleration_limit: 20.0", "acceleration_limit: 0.1\n      ramp_acceleration: 0.1")
    )
    (tmp_path / "a_file").write_text("")
    status, output, errors = run_main(*arguments)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert errors.startswith("error: ")
    for text in named:
        assert text in errors
    assert {path.name for path in tmp_path.iterdir()} - {"figures"} == {"other.yaml", "tight.yaml", "a_file"}
    assert not list(tmp_path.glob("figures/*"))


def test_without_matplotlib_one_line_says_so(run_main, monkeypatch, tmp_path):
    for name in [name for name in sys.modules if name.startswith(("bmd_rths_core.plots.", "matplotlib"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    status, output, errors = run_main(CONFIG)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert "matplotlib: not installed" in errors
    assert not list(tmp_path.iterdir())


def test_other_commands_do_not_wait_for_matplotlib():
    statement = "import sys, bmd_rths_nodes.cli.main; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", statement], stdin=subprocess.DEVNULL, timeout=120).returncode == 0
