"""Parameters that count steps no more: the old name is refused with the new one and its value, or converted."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bmd_rths_core.config import Config, config_from_mapping, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.renamed_parameters import STEPS_TO_SECONDS, convert_renamed
from bmd_rths_core.time_steps import exact_steps, most_steps

DEFAULTS_AT_200_HZ = {
    "run.max_consecutive_misses": 20,
    "command_shaper.alpha": 5.0,
    "safety.stale_shear_limit": 20,
    "safety.stale_controller_limit": 10,
    "safety.stuck_limit": 100,
}


def nested(values):
    mapping = {}
    for name, value in values.items():
        section, _, key = name.partition(".")
        mapping.setdefault(section, {})[key] = value
    return mapping


def test_defaults_of_today_are_those_of_before_at_200_hz():
    converted, changes = convert_renamed(nested(DEFAULTS_AT_200_HZ), 0.005)
    assert list(DEFAULTS_AT_200_HZ) == list(STEPS_TO_SECONDS)
    assert config_from_mapping(converted) == Config()
    assert len(changes) == len(DEFAULTS_AT_200_HZ)
    assert changes[2] == "safety.stale_shear_limit is now safety.stale_shear_time; 20 steps of 0.005 s are 0.1 s"


@pytest.mark.parametrize("old", STEPS_TO_SECONDS)
@pytest.mark.parametrize(("run", "seconds"), [({}, "0.035"), ({"run": {"time_step": 0.001}}, "0.007")])
def test_old_name_is_refused_with_the_new_one_and_its_value(old, run, seconds, tmp_path):
    new, step = STEPS_TO_SECONDS[old], run.get("run", {}).get("time_step", 0.005)
    section, _, key = old.partition(".")
    path = tmp_path / "old.yaml"
    lines = [f"    run: {{time_step: {step}}}"] if run and section != "run" else []
    inside = f"{key}: 7" + (f", time_step: {step}" if run and section == "run" else "")
    path.write_text("\n".join(["/**:", "  ros__parameters:", *lines, f"    {section}: {{{inside}}}"]))
    line = f"{old} is now {new}, in seconds; 7 steps of {step} s are {seconds} s"
    for refused in (lambda: load_config(path), lambda: Config().changed(run__time_step=step).merged(path)):
        with pytest.raises(InputError) as error:
            refused()
        assert str(error.value) == f"{path}: {line}"
    with pytest.raises(InputError) as error:
        Config().changed(run__time_step=step, **{old.replace(".", "__"): 7})
    assert str(error.value) == line


def test_old_name_with_something_that_is_no_number_is_refused_by_its_new_name():
    with pytest.raises(InputError, match=r"^safety.stuck_limit is now safety.stuck_time, in seconds$"):
        Config().changed(safety__stuck_limit="long")
    with pytest.raises(InputError, match=r"safety.stuck_limit: 'long' is not a number"):
        convert_renamed({"safety": {"stuck_limit": "long"}}, 0.005)


def test_conversion_keeps_everything_else_and_its_order():
    old = {"run": {"time_step": 0.01, "seed": 3}, "safety": {"force_limit": 1.0, "stuck_limit": 50, "x": 1}, "odd": 3}
    converted, _ = convert_renamed(old, 0.005)
    assert converted == {**old, "safety": {"force_limit": 1.0, "stuck_time": 0.5, "x": 1}}
    assert list(converted["safety"]) == ["force_limit", "stuck_time", "x"]
    assert convert_renamed(converted, 0.005) == (converted, [])


def test_both_names_at_once_are_refused():
    with pytest.raises(InputError, match=r"safety.stuck_limit: stands beside safety.stuck_time"):
        convert_renamed({"safety": {"stuck_limit": 50, "stuck_time": 0.5}}, 0.005)


@given(st.integers(1, 100_000), st.integers(100, 100_000))
def test_whole_steps_come_back_exactly(steps, microseconds):
    time_step = microseconds * 1e-6
    converted, _ = convert_renamed(nested({"run.time_step": time_step, "safety.stuck_limit": steps}), 0.005)
    seconds = converted["safety"]["stuck_time"]
    assert exact_steps(seconds, time_step) == steps
    assert most_steps(seconds, time_step) == steps
    assert most_steps(math.nextafter(seconds, 0.0), time_step) == steps  # what rounding has made smaller
    assert most_steps(seconds * (1.0 - 1e-9), time_step) == steps - 1


@given(st.decimals(0, 20, places=6))
def test_alpha_comes_back_bit_for_bit(alpha):
    converted, _ = convert_renamed(nested({"command_shaper.alpha": float(alpha)}), 0.005)
    assert exact_steps(converted["command_shaper"]["lead_time"], 0.005) == float(alpha)
