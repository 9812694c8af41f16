"""`bmd-rths stability`: the numbers of the paper from the command line, the verdict, and one line for wrong input."""

import json

import pytest

from tests.nodes.conftest import CONFIG

SIMPLIFIED, EIGHT_STORY = CONFIG, CONFIG.with_name("eight_story_bmd.yaml")
EQUATION_9 = (
    "simulated_table.sections=[1.0, 1.186, 3051.0, 1.0, 1.108, 2995.0, 1.0, 4.739, 10600.0, 1.0, 4.567, 10490.0, "
    "0.0, 0.0, 8960.0, 1.0, 97.46, 8960.0, 0.0, 0.0, 21300.0, 1.0, 21.07, 21300.0, "
    "0.0, 0.0, 61.661636485580146, 0.0, 1.0, 64.95]"
)
WITH_EQUATION_9 = ("--set", "simulated_table.dynamics=sections", "--set", EQUATION_9)
#: Configuration, arguments, modes, allowable mass ratio, critical frequency [rad/s]: the table of the margins that were
#: calculated from the paper.
CELLS = [
    (EIGHT_STORY, ("--scheme", "uc"), "identified", 0.1456, 36.09),
    (EIGHT_STORY, ("--scheme", "uc"), "all", 0.1430, 35.97),
    (EIGHT_STORY, ("--scheme", "plc"), "identified", 0.4729, 41.67),
    (EIGHT_STORY, ("--scheme", "plc"), "all", 0.2369, 60.34),
    (EIGHT_STORY, ("--scheme", "plc", "--feedback-delay", "1"), "identified", 0.2722, 38.05),
    (EIGHT_STORY, ("--scheme", "plc", "--feedback-delay", "1"), "all", 0.1864, 59.88),
    (EIGHT_STORY, ("--scheme", "uc", "--table", "perfect", "--feedback-delay", "1"), "identified", 0.7389, 47.90),
    (EIGHT_STORY, ("--scheme", "uc", "--table", "perfect", "--feedback-delay", "1"), "all", 0.4849, 61.72),
    (SIMPLIFIED, ("--scheme", "uc", "--table", "delay:25"), "identified", 0.1777, 92.96),
    (SIMPLIFIED, ("--scheme", "uc", "--table", "delay:25"), "all", 0.2090, 93.05),
    (SIMPLIFIED, ("--scheme", "uc", *WITH_EQUATION_9), "identified", 0.2359, 92.01),
    (SIMPLIFIED, ("--scheme", "uc", *WITH_EQUATION_9), "all", 0.2685, 92.14),
    (SIMPLIFIED, ("--scheme", "plc", "--table", "delay:25"), "identified", 0.0803, 95.25),
    (SIMPLIFIED, ("--scheme", "plc", "--table", "delay:25"), "all", 0.1052, 95.37),
]


@pytest.fixture
def result_of(run_main):
    """Return the JSON object of a call that has to succeed."""

    def result(*arguments):
        status, output, errors = run_main("stability", *arguments, "--json")
        assert (status, errors) == (0, "")
        return json.loads(output)

    return result


@pytest.mark.parametrize(("config", "arguments", "modes", "ratio", "frequency"), CELLS)
def test_margin_of_the_paper(result_of, config, arguments, modes, ratio, frequency):
    result = result_of(config, *arguments, "--modes", modes, "--no-sensitivity")
    assert round(result["allowable_mass_ratio"], 4) == ratio
    assert round(result["critical_frequency_rad_s"], 2) == frequency
    assert result["continuous"]["allowable_mass_ratio"] == result["allowable_mass_ratio"]
    assert result["discrete"]["confirmed"] is True
    assert result["modes"] == modes


def test_eight_story_system_is_no_go_and_a_share_of_its_shear_is_go(result_of):
    result = result_of(EIGHT_STORY, "--no-sensitivity")
    assert result["verdict"] == "no-go"
    assert round(result["mass_ratio"], 2) == 0.65
    assert result["mass_ratio"] == result["whole_mass_ratio"]
    analyses = [result[name] for name in ("continuous", "continuous_complete", "discrete")]
    assert [analysis["stable"] for analysis in analyses] == [False, False, False]
    assert result["discrete"]["spectral_radius"] > 1.0
    assert "NO-GO: mass ratio 0.650 is above the allowable 0.237" in result["verdict_text"]
    assert result["sensitivity"] is None
    share = 0.99 * result["largest_feedback_scale"]
    scaled = result_of(EIGHT_STORY, "--no-sensitivity", "--set", f"force_correction.feedback_scale={share}")
    assert (scaled["verdict"], scaled["stable"]) == ("go", True)
    assert scaled["mass_ratio"] < scaled["whole_mass_ratio"] == result["whole_mass_ratio"]
    assert scaled["discrete"]["spectral_radius"] < 1.0


@pytest.mark.parametrize("source", ["kalman", "load_cell"])
def test_eight_story_system_with_its_whole_shear_is_go_under_mpic(run_main, result_of, source):
    arguments = (EIGHT_STORY, "--scheme", "mpic", "--no-sensitivity", "--set", f"shear_estimator.source={source}")
    result = result_of(*arguments)
    assert (result["verdict"], round(result["mass_ratio"], 2)) == ("go", 0.65)
    assert result["mass_ratio"] == result["whole_mass_ratio"]
    assert result["continuous"] is result["continuous_complete"] is result["largest_feedback_scale"] is None
    assert result["discrete"]["confirmed"] is True
    assert result["verdict_text"].startswith("GO: the loop of mpic is stable at mass ratio 0.650, and with a real")


def test_analyses_that_do_not_apply_say_so(run_main):
    status, output, _ = run_main("stability", SIMPLIFIED, "--scheme", "mpic", "--no-sensitivity")
    assert (status, output.count("not applicable")) == (0, 2)
    status, _, errors = run_main("stability", SIMPLIFIED, "--scheme", "mpic", "--no-sensitivity", "--sweep")
    assert (status, errors.count("\n")) == (2, 1)
    assert "--sweep: only for the schemes of the paper" in errors


@pytest.mark.slow
def test_everything_of_the_object(result_of):
    result = result_of(SIMPLIFIED, "--scheme", "plc", "--sweep", "--modes", "1", "--feedback-delay", "2")
    assert (result["scheme"], result["table"], result["modes"], result["feedback_delay_steps"]) == (
        *("plc", "identified", "1"),
        2,
    )
    curve = result["sweep"]
    assert {len(values) for values in curve.values()} == {200}
    assert curve["numerical_frequency_rad_s"][0] < 94.09 < curve["numerical_frequency_rad_s"][-1]
    lead = next(entry for entry in result["sensitivity"] if entry["parameter"] == "command_shaper.lead_time")
    assert [lead["decreased"]["value"], lead["increased"]["value"]] == pytest.approx([0.0225, 0.0275], rel=1e-12)
    assert set(lead["increased"]["allowable_mass_ratio"]) == {"continuous", "continuous_complete", "discrete"}
    scale = next(e for e in result["sensitivity"] if e["parameter"] == "force_correction.feedback_scale")
    assert "<= 1 is required" in scale["increased"]["not_allowed"]


def test_infinite_and_missing_numbers_are_null(result_of):
    result = result_of(SIMPLIFIED, "--scheme", "uc", "--table", "perfect", "--no-sensitivity")
    assert result["critical_frequency_rad_s"] is None
    assert result["stable"] is True


def test_measured_response_without_a_fit_has_no_discrete_analysis(run_main, result_of, tmp_path):
    (tmp_path / "table.csv").write_text("frequency_hz,magnitude,phase_deg\n0.1,1,-0.9\n50,1,-450\n100,0.1,-900\n")
    result = result_of(SIMPLIFIED, "--scheme", "uc", "--table", "table.csv", "--no-sensitivity")
    assert result["discrete"] is None
    assert "the measured frequency response of the table has no fit" in result["discrete_reason"]
    _, output, _ = run_main("stability", SIMPLIFIED, "--table", "table.csv", "--no-sensitivity")
    assert "No discrete analysis" in output
    assert "known up to 100 Hz" in output


def test_person_reads_the_verdict_first(run_main):
    status, output, errors = run_main("stability", EIGHT_STORY, "--no-sensitivity", "--sweep")
    assert (status, errors) == (0, "")
    assert output.startswith("NO-GO: mass ratio 0.650 is above the allowable")
    for text in (
        "UNSTABLE",
        "allowable mass ratio",
        "spectral radius",
        "confirmed by simulation",
        "over the numerical",
    ):
        assert text in output


@pytest.mark.slow
def test_person_reads_the_sensitivity(run_main):
    _, output, _ = run_main("stability", SIMPLIFIED, "--scheme", "uc")
    for text in ("GO: ", "specimen.stiffnesses[0]", "numerical_substructure.damping_coefficients[0]", "not allowed"):
        assert text in output


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--table", "delay:abc"), ["--table delay:abc", "0 to 1000 ms"]),
        (("--table", "delay:-1"), ["--table delay:-1", "0 to 1000 ms"]),
        (("--table", "delay:nan"), ["--table delay:nan", "0 to 1000 ms"]),
        (("--table", "identifed"), ["--table identifed", "identified, perfect, delay:MS"]),
        (("--table", "none.csv"), ["none.csv", "No such file"]),
        (("--table", "header.csv"), ["header.csv", "line 1", "magnitude"]),
        (("--table", "text.csv"), ["text.csv", "line 3", "'loud'"]),
        (("--modes", "0"), ["modes: 0", "1 to 2"]),
        (("--modes", "3"), ["modes: 3", "1 to 2"]),
        (("--modes", "first"), ["modes: first", "identified, all"]),
        (("--feedback-delay", "-1"), ["--feedback-delay", "-1"]),
        (("--feedback-delay", "1.5"), ["--feedback-delay", "1.5"]),
        (("--set", "specimen.damping_coefficients=[0.0, 0.0]"), ["damping_ratio 0"]),
        (("--set", "simulated_table.sections=[1.0]", *WITH_EQUATION_9[:2]), ["simulated_table.sections"]),
    ],
)
def test_wrong_input_is_one_clear_line(run_main, tmp_path, arguments, named):
    (tmp_path / "header.csv").write_text("frequency_hz,phase_deg\n1,0\n2,0\n")
    (tmp_path / "text.csv").write_text("frequency_hz,magnitude,phase_deg\n1,1,0\n2,loud,0\n")
    status, output, errors = run_main("stability", SIMPLIFIED, *arguments)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert errors.startswith("error: ")
    for text in named:
        assert text in errors


@pytest.mark.slow
def test_files_that_identify_writes_are_tables(run_main, result_of, tmp_path):
    """Measured in one noisy run, as a model and as data, the table has the margin of the true one, within a few %."""
    files = ("--output", tmp_path / "model.yaml", "--frf", tmp_path / "measured.csv")
    status, _, errors = run_main("identify", SIMPLIFIED, "--what", "table", "--duration", 60, *files, "--json")
    assert status == 0, errors
    asked = (SIMPLIFIED, "--scheme", "uc", "--no-sensitivity")
    true, by_option, model, data = (
        result_of(*asked, *table) for table in ((), ("--model", files[1]), ("--table", files[1]), ("--table", files[3]))
    )
    assert model["allowable_mass_ratio"] == by_option["allowable_mass_ratio"] != true["allowable_mass_ratio"]
    assert model["allowable_mass_ratio"] == pytest.approx(true["allowable_mass_ratio"], rel=0.01)
    assert model["discrete"]["allowable_mass_ratio"] == pytest.approx(
        true["discrete"]["allowable_mass_ratio"], rel=0.01
    )
    assert data["allowable_mass_ratio"] == pytest.approx(true["allowable_mass_ratio"], rel=0.05)
    assert data["discrete"]["allowable_mass_ratio"] == pytest.approx(true["discrete"]["allowable_mass_ratio"], rel=0.05)


def test_table_of_a_model_replaces_nothing_but_the_table(result_of, tmp_path):
    """The delay constant and the specimen in the file are not those of the test, and what is set stays set."""
    model = tmp_path / "model.yaml"
    table = "simulated_table: {dynamics: servo, servo_real_pole: 40.0}"
    others = "command_shaper: {lead_time: 0.045}\n    specimen: {masses: [1500.0, 1600.0]}"
    model.write_text(f"/**:\n  ros__parameters:\n    {table}\n    {others}\n")
    same = ("--set", "simulated_table.dynamics=servo", "--set", "simulated_table.servo_real_pole=40.0")
    for settings in ((), ("--set", "command_shaper.lead_time=0.015")):
        asked = (SIMPLIFIED, "--no-sensitivity", *settings)
        with_file, by_hand = result_of(*asked, "--table", model), result_of(*asked, *same)
        for name in ("mass_ratio", "allowable_mass_ratio", "verdict_text"):
            assert with_file[name] == by_hand[name]
