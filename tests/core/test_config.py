"""Configuration: one file, one declaration a parameter, one clear line for everything that is wrong."""

from dataclasses import fields, replace
from pathlib import Path

import pytest
import yaml

from bmd_rths_core.config import SECTIONS, Config, config_from_mapping, dump_config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import specs

ROOT = Path(__file__).parents[2]
SHIPPED = sorted((ROOT / "config").glob("*.yaml"))


def refused(tmp_path, text):
    path = tmp_path / "test.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        load_config(path)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    return message.removeprefix(str(path))


def below(*lines):
    return "/**:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in lines)


def test_defaults_are_the_simplified_bmd_file_with_record_and_specimen_as_they_are():
    """Nobody who has not asked for it gets a changed record, a specimen that is not its model, or its models."""
    as_they_are = {"ground_motion__time_scale": 1.0, "simulated_table__specimen_stiffness_factor": 1.0}
    shipped = load_config(ROOT / "config" / "simplified_bmd.yaml").changed(**as_they_are)
    assert replace(shipped, identified_model=Config().identified_model) == Config()


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_dumped_configuration_reads_back_equal(path, tmp_path):
    config = load_config(path)
    copy = tmp_path / "copy.yaml"
    copy.write_text(dump_config(config))
    assert load_config(copy) == config
    assert config_from_mapping(config.as_mapping()) == config


def test_section_names_are_the_field_names():
    own = [f.name for f in fields(Config) if f.name != "compensation"]
    compensation = [section.SECTION for section in Config().compensation]
    assert [*own, *compensation] == [section.SECTION for section in SECTIONS.values()] == list(SECTIONS)


@pytest.mark.parametrize("section", SECTIONS.values(), ids=SECTIONS)
def test_every_parameter_is_described_and_every_number_has_a_unit(section):
    for name, spec in specs(section).items():
        assert spec.description, name
        assert not spec.description.endswith("."), name
        default = getattr(section(), name)
        is_number = isinstance(default, (float, tuple)) or (isinstance(default, int) and not isinstance(default, bool))
        assert bool(spec.unit) == is_number, name


def test_changed_validates_and_leaves_the_original():
    config = Config()
    assert config.changed(run__scheme="uc").run == replace(config.run, scheme="uc")
    assert config.run.scheme == "plc_fc"
    with pytest.raises(
        InputError, match=r"run\.sheme: unknown parameter, did you mean scheme\?; allowed here: time_st"
    ):
        config.changed(run__sheme="uc")


def test_changed_keeps_the_sections_that_nothing_changes():
    """And no other: of a section that is named every value is checked, and what follows from it is made anew."""
    config = Config()
    faster = config.changed(run__time_step=0.0025)
    kept = {name for name in SECTIONS if faster.section(name) is config.section(name)}
    assert set(SECTIONS) - kept == {"run", "virtual_controller"}
    assert faster == config_from_mapping(faster.as_mapping())
    one = config.changed(command_shaper__w1=1.5, command_shaper__w2=1.0)
    with pytest.raises(InputError, match=r"command_shaper\.w2: True is not a number"):
        one.changed(command_shaper__w2=True)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["specimen:", "  masses: [-760.0, 800.0]"], "specimen.masses: [-760, 800] is not allowed; >= 0.1 kg and"),
        (
            ["specimen:", "  mases: [1.0]"],
            "specimen.mases: unknown parameter, did you mean masses?; allowed here: ",
        ),
        (["specimen:", "  masses: 760.0"], "specimen.masses: 760.0 is not a list; a list of numbers in kg is required"),
        (["specimen:", "  masses: [1.0]"], "specimen: masses, stiffnesses and damping_coefficients need one entry a"),
        (
            ["specimens:", "  masses: [1.0]"],
            "specimens: unknown section, did you mean specimen?; allowed here: run,",
        ),
        (["run: 5"], "run: 5 is not a section; parameters with values are required"),
        (["run:", "  scheme: plcfc"], "run.scheme: 'plcfc' is not allowed; one of uc, fc, plc, plc_fc, "),
        (["run:", "  time_step: 0.0"], "run.time_step: 0.0 is not allowed; >= 0.0001 s and <= 0.1 s is required"),
        (["run:", "  time_step: .nan"], "run.time_step: nan is not allowed"),
        (["run:", "  seed: 1.5"], "run.seed: 1.5 is not a whole number; >= 0 and <= 2147483647 is required"),
        (["run:", "  lockstep: 1"], "run.lockstep: 1 is neither true nor false"),
        (["run:", "  seed: true"], "run.seed: True is not a whole number"),
        (["run:", "  scheme: uc", "  scheme: fc"], " line 5: not valid YAML: 'scheme' is given twice"),
        (["command_shaper:", "  w1: 0.5"], "W1 = 0.5, W2 = 2 put a pole of the phase-lead compensator on or outside"),
        (["force_correction:", "  gain: 1.5"], "force_correction.gain: 1.5 is not allowed; >= 0 and <= 1 is required"),
        (["ground_motion:", "  record: ''"], "ground_motion.record: empty; a path or the name of a shipped record"),
        (["ground_motion:", "  record: 7"], "ground_motion.record: 7 is not text"),
    ],
)
def test_wrong_values_are_refused_with_one_line_that_names_file_parameter_value_and_what_is_allowed(
    tmp_path, lines, message
):
    assert message in refused(tmp_path, below(*lines))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no parameters found; they are required below '/**:' and 'ros__parameters:'"),
        ("/**: 3\n", "no parameters found"),
        ("/**:\n  ros__parameters: 3\n", "'ros__parameters:' holds 3; sections are required"),
        ("/**:\n  ros__parameters:\n    run: [\n", " line "),
    ],
)
def test_files_that_are_no_parameter_files_are_refused(tmp_path, text, message):
    assert message in refused(tmp_path, text)


def test_missing_file_and_directory_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml: cannot be read: No such file or directory"):
        load_config(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        load_config(tmp_path)
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot be read"):
        load_config(binary)


def test_dumped_file_is_a_ros_parameter_file():
    document = yaml.safe_load(dump_config(Config()))
    assert list(document) == ["/**"]
    assert list(document["/**"]) == ["ros__parameters"]


def test_partial_file_replaces_what_it_names_and_nothing_else(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(below("command_shaper: {lead_time: 0.019}", "specimen: {identified_frequency: 30.0}"))
    config = Config().changed(run__scheme="uc", command_shaper__w1=3.0)
    assert config.merged(path) == config.changed(command_shaper__lead_time=0.019, specimen__identified_frequency=30.0)


def test_specimen_of_other_height_is_refused(tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(below("specimen:", "  masses: [760.0]", "  stiffnesses: [1000.0]", "  damping_coefficients: [0.0]"))
    with pytest.raises(InputError, match=r"model.yaml: specimen.masses has 1 entries, the configuration 2"):
        Config().merged(path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (below("command_shaper: {alfa: 3.8}"), "command_shaper.alfa: unknown parameter"),
        (below("shaper: {lead_time: 0.019}"), "shaper: unknown section"),
        (below("shaper: 3.8"), "shaper: unknown section"),
        (below("command_shaper: 3.8"), "command_shaper: 3.8 is not a section"),
        (below("specimen: {masses: [1.0]}"), "one entry a story"),
        ("a: [", "not valid YAML"),
        ("a: 1", "no parameters found"),
    ],
)
def test_wrong_partial_file_is_named_in_one_line(text, expected, tmp_path):
    path = tmp_path / "model.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=expected) as error:
        Config().merged(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_missing_partial_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml: cannot be read"):
        Config().merged(tmp_path / "none.yaml")


@pytest.mark.parametrize("text", ["5e-3", "5.0e-3", "5.E-3", "+0.5e-2", ".5e-2"])
def test_number_with_an_exponent_is_a_number(text, tmp_path):
    """As it is for ROS, which reads the same file."""
    path = tmp_path / "config.yaml"
    path.write_text(f"/**:\n  ros__parameters:\n    run:\n      time_step: {text}\n")
    assert load_config(path).run.time_step == 0.005
