"""Typical mistakes of somebody who describes a rig: each is refused or warned of in one line."""

import numpy as np
import pytest

from bmd_rths_core.analysis.suspicions import suspicions
from bmd_rths_core.config import Config, config_from_mapping, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import GroundMotion
from bmd_rths_core.ground_motion.config import GroundMotionConfig, prepare_ground_motion
from bmd_rths_core.identification.excited_table import Responses
from bmd_rths_core.identification.specimen_model import identify_specimen
from tests.core.test_config import SHIPPED

#: A rig without a mistake.
RIG = {
    "rig": {"stroke": 0.1, "velocity": 0.5, "acceleration": 10.0, "force": 1e5},
    "specimen": {
        "masses": [1000.0, 900.0],
        "stiffnesses": [1.5e6, 1.2e6],
        "damping": "modal",
        "damping_ratios": [0.02],
    },
    "numerical_substructure": {
        "masses": [20000.0, 20000.0, 18000.0],
        "stiffnesses": [5e7, 4.5e7, 4e7],
        "damping": "modal",
        "damping_ratios": [0.03],
    },
}


def changed(section, **values):
    return {**RIG, section: {**RIG.get(section, {}), **values}}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_the_shipped_configurations_look_like_no_mistake(path):
    assert suspicions(load_config(path)) == []


def test_a_rig_without_a_mistake_looks_like_none():
    assert suspicions(config_from_mapping(RIG)) == []


@pytest.mark.parametrize(
    ("section", "values", "warning"),
    [
        pytest.param(
            "specimen",
            {"masses": [1.0, 0.9], "stiffnesses": [1500.0, 1200.0]},
            "specimen.masses: 1.9 kg in all looks like t; multiply masses by 1000 (and stiffnesses, if 1500 N/m",
            id="masses in t, stiffnesses in kN/m",
        ),
        pytest.param(
            "numerical_substructure",
            {"masses": [20.0, 20.0, 18.0], "stiffnesses": [5e7, 4.5e7, 4e7]},
            "masses look like t",
            id="masses in t",
        ),
        pytest.param(
            "numerical_substructure",
            {"stiffnesses": [5e4, 4.5e4, 4e4]},
            "numerical_substructure.stiffnesses: first mode at 0.112 Hz, 8.96 s; 50000 N/m looks like kN/m",
            id="stiffnesses in kN/m",
        ),
        pytest.param(
            "specimen",
            {"damping_ratios": [2.0]},
            "specimen.damping_ratios: 2 looks like percent; 0.02 would be 2 %",
            id="percent",
        ),
        pytest.param(
            "rig", {"stroke": 100.0}, "rig.stroke: 100 m looks like mm; 0.1 m would be that", id="stroke in mm"
        ),
        pytest.param(
            "rig",
            {"force": 100.0},
            "rig.force: 100 N on a specimen of 1900 kg looks like kN; 100000 N would be that",
            id="force in kN",
        ),
        pytest.param(
            "numerical_substructure",
            {"masses": [18000.0, 20000.0, 20000.0], "stiffnesses": [3e7, 4.5e7, 5e7]},
            "numerical_substructure: the top story has 5e+07 N/m, the first one 3e+07 N/m; they look like stories from",
            id="stories in reverse order",
        ),
    ],
)
def test_numbers_in_another_unit_or_order_are_warned_of_in_one_line(section, values, warning):
    (told,) = suspicions(config_from_mapping(changed(section, **values)))
    assert warning in told
    assert "\n" not in told


def test_a_limit_in_millimetres_is_warned_of_where_no_capacity_is_told():
    (told,) = suspicions(Config().changed(safety__displacement_limit=90.0))
    assert told == "safety.displacement_limit: 90 m looks like mm; 0.09 m would be that"


@pytest.mark.parametrize(
    ("section", "values", "message"),
    [
        pytest.param(
            "specimen",
            {"masses": [1000.0, 900.0, 800.0]},
            "specimen: masses, stiffnesses and damping_coefficients need one entry a story each; they have 3, 2 and 3",
            id="length",
        ),
        pytest.param(
            "run",
            {"time_step": "0,002"},
            "run.time_step: '0,002' is not a number (a decimal point, not a comma, is required: 0.002)",
            id="comma",
        ),
        pytest.param(
            "specimen",
            {"stifnesses": [1.5e6, 1.2e6]},
            "specimen.stifnesses: unknown parameter, did you mean stiffnesses?",
            id="misspelt key",
        ),
        pytest.param("specimem", {"masses": [1.0]}, "specimem: unknown section, did you mean specimen?", id="section"),
        pytest.param(
            "run",
            {"time_step": 500.0},
            "run.time_step: 500 s is not allowed; >= 0.0001 s and <= 0.1 s is required (500 Hz, if that is meant, are "
            "0.002 s)",
            id="rate for step",
        ),
        pytest.param(
            "safety",
            {"displacement_limit": 90.0},
            "safety.displacement_limit: 90 m is above the capacity of the table; <= 0.1 m, rig.stroke, is required",
            id="capacity exceeded",
        ),
    ],
)
def test_what_cannot_be_right_is_refused_in_one_line(section, values, message):
    with pytest.raises(InputError) as error:
        config_from_mapping(changed(section, **values))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_numbers_as_ros_takes_them_are_numbers(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("/**: {ros__parameters: {specimen: {masses: [8.0e2, 8e2], stiffnesses: [8.0e6, 8.0e+6]}}}")
    assert load_config(path).specimen.stiffnesses == (8e6, 8e6)


def test_a_record_whose_step_does_not_divide_is_refused_with_what_helps():
    record = GroundMotion("test", 0.0073, np.ones(10), "test", "0" * 64)
    with pytest.raises(InputError, match=r"has 0\.0073 s, and a whole multiple .* or ground_motion\.resample=true"):
        prepare_ground_motion(record, GroundMotionConfig(), 0.005)


@pytest.mark.parametrize("floor", [1, 2])
def test_the_wrong_sign_of_one_accelerometer_is_refused(floor):
    """A specimen on a table in slow noise: its floors follow, but one is told upside down."""
    config, dt, random = Config(), 0.005, np.random.default_rng(0)
    table = np.convolve(random.standard_normal(12_000), np.hanning(9), "same")
    a, b, c = config.specimen.building().relative_motion()
    from bmd_rths_core.integration.discretisation import first_order_hold

    phi, before, now = first_order_hold(a, b, dt)
    state, floors = np.zeros(len(a)), np.zeros((len(table), 2))
    for k in range(1, len(table)):
        state = phi @ state + before[:, 0] * table[k - 1] + now[:, 0] * table[k]
        floors[k] = c @ state
    floors[:, floor - 1] *= -1.0
    responses = Responses(dt, table, table, floors, "driven", 0.0, 0.0)
    with pytest.raises(InputError, match=rf"specimen: floor {floor} moves against the table at 0\.\d+ Hz"):
        identify_specimen(responses, config.specimen.masses, (2 * np.pi * 0.5, 2 * np.pi * 20.0))
