"""`bmd-rths identify`: what it prints and writes, and that other commands take it."""

import json
import math

import pytest
import yaml

from bmd_rths_core.config import load_config
from tests.nodes.conftest import CONFIG

SHORT = ("--duration", 40)


@pytest.mark.slow
def test_json_tells_table_specimen_and_files(run_main, tmp_path):
    model, measured = tmp_path / "model.yaml", tmp_path / "measured.csv"
    status, output, _ = run_main("identify", CONFIG, *SHORT, "--output", model, "--frf", measured, "--json")
    assert status == 0
    result = json.loads(output)
    assert (result["order"], len(result["poles"])) == (7, 7)  # of the table, and two modes that pull at it
    assert result["delay"]["ms"] == pytest.approx(21.0, abs=0.2)
    assert result["delay"]["steps"] == pytest.approx(result["delay"]["ms"] / 5.0)
    assert result["delay"]["band_hz"] == [0.5, 8.0]
    assert result["fit_error_percent"] < 5.0
    assert 0.9 < result["coherence"]["smallest"] <= result["coherence"]["median"] <= 1.0
    specimen = result["specimen"]
    # What is found is the specimen on the table, which is stiffer than the model of the file.
    config = load_config(CONFIG)
    real = config.simulated_table.specimen(config.specimen.building())
    assert specimen["frequencies_hz"] == pytest.approx(real.modes().frequencies / (2.0 * math.pi), abs=0.05)
    assert specimen["damping_ratios"] == pytest.approx(real.modes().damping_ratios, abs=3e-3)
    assert specimen["stiffnesses"] == pytest.approx(real.stiffnesses, rel=5e-3)
    assert result["files"] == {"output": str(model), "frf": str(measured)}
    assert measured.read_text().startswith("frequency_hz,magnitude,phase_deg,coherence\n")

    text = model.read_text()
    assert text.startswith("# Identified by bmd-rths identify on ")
    assert "noise of 2 m/s2 for 40 s, seed 0" in text
    sections = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert list(sections) == ["command_shaper", "simulated_table", "specimen", "identified_model"]
    merged = config.merged(model)
    assert merged.identified_model.table == result["identified_model"]["table"] == "interacting_servo"
    assert merged.identified_model.stiffnesses == pytest.approx(real.stiffnesses, rel=1e-3)
    assert result["identified_model"]["noise"]["shear_noise"] == pytest.approx(20.0, rel=0.1)
    assert merged.simulated_table.specimen_stiffness_factor == 1.0
    assert merged.command_shaper.lead_time == pytest.approx(1e-3 * result["delay"]["ms"], abs=5e-7)
    status, output, _ = run_main("simulate", CONFIG, "--model", model, "--json")
    assert status == 0
    assert json.loads(output)["stable"]


def test_compensator_gets_the_identified_model_and_the_virtual_laboratory_stays(run_main, tmp_path):
    model = tmp_path / "model.yaml"
    model.write_text(
        "/**:\n  ros__parameters:\n    identified_model: {table: interacting_servo, servo_real_pole: 44.0}\n"
        "    specimen: {masses: [760.0, 800.0], stiffnesses: [1e6, 1e6], damping_coefficients: [1e3, 1e3]}\n"
    )
    config, merged = load_config(CONFIG), load_config(CONFIG).merged(model, ("identified_model",))
    assert merged.specimen == config.specimen
    assert merged.identified_model.servo_real_pole == 44.0
    short = ("--set", "ground_motion.duration=1.0", "--json")
    told = [run_main("simulate", CONFIG, "--scheme", "mpic", *o, *short) for o in ((), ("--identified", model))]
    assert [status for status, _, _ in told] == [0, 0]
    assert json.loads(told[0][1])["rmse_percent"] != json.loads(told[1][1])["rmse_percent"]


def test_file_without_an_identified_model_is_refused(run_main, tmp_path):
    model = tmp_path / "model.yaml"
    model.write_text("/**:\n  ros__parameters:\n    command_shaper: {lead_time: 0.02}\n")
    status, _, errors = run_main("simulate", CONFIG, "--identified", model)
    assert (status, errors) == (2, f"error: {model}: no section identified_model; it has command_shaper\n")


def test_later_model_and_set_win(run_main, tmp_path):
    first, second = tmp_path / "first.yaml", tmp_path / "second.yaml"
    for path, lead_time in ((first, 0.005), (second, 0.01)):
        path.write_text(f"/**:\n  ros__parameters:\n    command_shaper: {{lead_time: {lead_time}}}\n")
    common = ("simulate", CONFIG, "--scheme", "plc", "--set", "ground_motion.duration=2.0", "--json")

    def errors(*options):
        status, output, _ = run_main(*common, *options)
        assert status == 0
        return json.loads(output)["rmse_percent"]

    two = errors("--set", "command_shaper.lead_time=0.01")
    assert errors("--model", first, "--model", second) == two
    assert errors("--model", first, "--set", "command_shaper.lead_time=0.01") == two
    assert errors("--model", first) != two


@pytest.mark.slow
def test_bag_is_identified_without_driving(run_main, tmp_path):
    _, output, _ = run_main("simulate", CONFIG, "--scheme", "fc", "--output", tmp_path / "bags", "--json")
    bag = json.loads(output)["bag"]
    arguments = ("--bag", bag, "--band", 1, 15, "--delay-band", 1, 8, "--json")
    status, output, _ = run_main("identify", CONFIG, *arguments)
    assert status == 0
    result = json.loads(output)
    assert result["source"] == f"steps 0 to 3598 of 3599 of {bag}"
    assert result["delay"]["ms"] == pytest.approx(21.0, abs=1.0)
    # An earthquake excites little at some frequencies, and that is told.
    assert result["specimen"]["coherence"]["incoherent_bands_hz"]
    assert result["specimen"]["frequencies_hz"][0] == pytest.approx(5.94 * math.sqrt(1.049), abs=0.05)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [((), "no_bag: "), (("--amplitude", 2), "--amplitude, --bag: not together; the motion is that of the bag")],
)
def test_wrong_bag_and_options_that_would_say_how_to_move_are_refused(run_main, arguments, expected):
    status, output, errors = run_main("identify", CONFIG, "--bag", "no_bag", *arguments)
    assert (status, output) == (2, "")
    assert expected in errors
    assert errors.count("\n") == 1


@pytest.mark.slow
def test_table_for_a_person(run_main):
    status, output, _ = run_main("identify", CONFIG, *SHORT, "--order", 3)
    assert status == 0
    for text in ("delay alpha", "mode 2", "story 1", "both together", "platen mass", "shear 2", "largest acceleration"):
        assert text in output


@pytest.mark.slow
def test_only_what_is_asked_for(run_main):
    _, output, _ = run_main("identify", CONFIG, *SHORT, "--what", "specimen", "--json")
    assert "order" not in json.loads(output)
    _, output, _ = run_main("identify", CONFIG, *SHORT, "--what", "table", "--order", 3, "--json")
    assert {"specimen", "identified_model"}.isdisjoint(json.loads(output))


def test_command_over_the_safety_limit_has_status_1(run_main):
    status, output, errors = run_main(
        "identify", CONFIG, *SHORT, "--set", "safety.acceleration_limit=0.5", "--set", "safety.ramp_acceleration=0.5"
    )
    assert (status, output) == (1, "")
    assert "safety.acceleration_limit" in errors


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--order", "many"), "--order many: auto or a whole number"),
        (("--order", 0), "--order 0"),
        (("--amplitude", 30), "mm are allowed"),
        (("--amplitude", 0.01), "% of the band has a coherence"),
        (("--band", 25, 5), "rising band"),
        (("--output", "no/such/model.yaml"), "no such folder"),
        (("--what", "specimen", "--frf", "a.csv"), "--frf"),
        (("--model", "none.yaml"), "none.yaml: cannot be read"),
        (("--bag", "no_bag"), "--duration, --bag: not together"),
    ],
)
def test_wrong_input_is_one_line_with_status_2(run_main, arguments, expected):
    status, output, errors = run_main("identify", CONFIG, *SHORT, *arguments)
    assert (status, output) == (2, "")
    assert expected in errors
    assert errors.count("\n") == 1
