"""The capacity of a table: limits and the emulated actuator follow from it; nothing changes where it is not told."""

from dataclasses import replace

import numpy as np
import pytest

from bmd_rths_core.config import Config, config_from_mapping, dump_config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_virtual_controller
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.models.servo_hydraulic import ServoHydraulicConfig
from bmd_rths_core.table.rig import RigConfig

#: A table of ±100 mm and ±100 kN.
RIG = {"stroke": 0.1, "velocity": 0.5, "acceleration": 10.0, "force": 1e5}
PAPER = {"stroke": 0.25, "velocity": 1.0, "acceleration": 30.0, "force": 5e5}


def of_rig(**others):
    return config_from_mapping({"rig": RIG, **others})


def test_limits_and_interlocks_follow_from_the_capacity():
    config = of_rig()
    safety, controller = config.safety, config.virtual_controller
    assert (safety.displacement_limit, safety.velocity_limit) == (0.092, 0.45)
    assert (safety.acceleration_limit, safety.force_limit) == (9.0, 9e4)
    assert (controller.displacement_limit, controller.velocity_limit) == (0.1, 0.5)
    assert (controller.acceleration_limit, controller.force_limit) == (10.0, 1e5)
    assert safety.ramp_velocity <= safety.velocity_limit
    assert safety.increment_limit < safety.acceleration_limit


def test_the_actuator_is_consistent_with_its_capacity():
    """Force is pressure times area, flow is area times velocity, and the oil fills both strokes and a tenth more."""
    hydraulic = of_rig().servo_hydraulic
    area = 1e5 / 20.7e6
    assert hydraulic.piston_area == pytest.approx(area)
    assert hydraulic.rated_velocity == 0.5
    assert hydraulic.oil_volume == pytest.approx(1.1 * area * 0.2)
    assert of_rig(servo_hydraulic={"supply_pressure": 28e6}).servo_hydraulic.oil_volume == pytest.approx(
        1.1 * (1e5 / 28e6) * 0.2
    )
    # Merritt 1967, section 6-2: the oil column is a spring of 4 beta A^2 / V.
    assert hydraulic.oil_frequency_squared == pytest.approx(4 * 7e8 * area**2 / hydraulic.oil_volume / 1000.0)


def test_the_table_of_the_paper_gives_its_own_defaults():
    derived, default = config_from_mapping({"rig": PAPER}), Config()
    assert derived.safety == replace(
        default.safety, velocity_limit=0.9, acceleration_limit=27.0, force_limit=4.5e5, increment_limit=20.25
    )
    assert derived.virtual_controller == default.virtual_controller
    of_default = ServoHydraulicConfig()
    for name in ("force_capacity", "stroke", "platen_mass", "viscous_damping", "coulomb_friction", "rated_velocity"):
        assert getattr(derived.servo_hydraulic, name) == getattr(of_default, name), name
    for name in ("oil_volume", "pressure_feedback", "valve_frequency"):
        assert getattr(derived.servo_hydraulic, name) == pytest.approx(getattr(of_default, name), rel=2e-3), name


def test_without_a_capacity_nothing_follows():
    assert config_from_mapping({}) == Config() == config_from_mapping({"rig": {}})
    only_stroke = config_from_mapping({"rig": {"stroke": 0.1}})
    assert only_stroke.safety.velocity_limit == Config().safety.velocity_limit
    assert only_stroke.servo_hydraulic.force_capacity == Config().servo_hydraulic.force_capacity


def test_what_is_given_counts_more_than_what_follows(tmp_path):
    config = of_rig(safety={"displacement_limit": 0.05})
    assert config.safety.displacement_limit == 0.05
    path = tmp_path / "rig.yaml"
    path.write_text(dump_config(config))
    assert load_config(path) == config
    assert config_from_mapping(config.as_mapping()) == config


def test_a_changed_capacity_changes_what_followed_and_leaves_what_was_given(tmp_path):
    config = of_rig(safety={"force_limit": 5e4})
    smaller = config.changed(rig__stroke=0.05)
    assert smaller.safety.displacement_limit == 0.046
    assert smaller.safety.force_limit == 5e4
    assert smaller.safety.velocity_limit == 0.45
    assert Config().changed(rig__stroke=0.1).safety.displacement_limit == 0.092
    assert config.changed(rig__stroke=0.0).safety.displacement_limit == Config().safety.displacement_limit
    path = tmp_path / "rig.yaml"
    path.write_text("/**: {ros__parameters: {rig: {stroke: 0.05}}}")
    assert config.merged(path) == smaller


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"safety": {"displacement_limit": 90.0}},
            "safety.displacement_limit: 90 m is above the capacity of the table; <= 0.1 m, rig.stroke, is required "
            "(given in thousandths, it is 0.09 m)",
        ),
        ({"safety": {"force_limit": 2e5}}, "safety.force_limit: 200000 N is above the capacity of the table"),
        (
            {"virtual_controller": {"velocity_limit": 0.6}},
            "virtual_controller.velocity_limit: 0.6 m/s is above the capacity of the table; <= 0.5 m/s, rig.velocity",
        ),
        ({"safety": {"acceleration_limit": 20.0}}, "<= 10 m/s2, rig.acceleration, is required"),
        ({"rig": {"stroke": -0.1}}, "rig.stroke: -0.1 is not allowed"),
        ({"rig": {"strok": 0.1}}, "rig.strok: unknown parameter"),
        ({"rig": 5}, "rig: 5 is not a section"),
    ],
)
def test_a_limit_above_the_capacity_is_refused_in_one_line(changes, message):
    with pytest.raises(InputError) as error:
        config_from_mapping({"rig": RIG, **changes})
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_the_emulated_table_is_refused_when_its_poles_are_not_stable():
    """An actuator of 100 kN with the oil of one of 500 kN: what reached 77 m/s² once."""
    with pytest.raises(InputError, match=r"servo_hydraulic: the emulated table is not stable, with a pole at"):
        make_virtual_controller(
            Config().changed(servo_hydraulic__force_capacity=1e5, servo_hydraulic__oil_volume=0.0133), Faults()
        )
    make_virtual_controller(Config(), Faults())


@pytest.mark.parametrize("force", [2e4, 1e5, 1e6])
@pytest.mark.parametrize("stroke", [0.05, 0.1, 0.5])
def test_a_derived_actuator_is_stable_and_follows(force, stroke):
    """With a specimen of half the mass that the force can accelerate at 1 g, at 4 Hz."""
    mass = force / 9.81 / 2.0
    specimen = {
        "masses": [mass],
        "stiffnesses": [mass * (2 * np.pi * 4.0) ** 2],
        "damping_coefficients": [2 * 0.02 * 2 * np.pi * 4.0 * mass],
    }
    config = config_from_mapping({"rig": {"force": force, "stroke": stroke}, "specimen": specimen})
    make_virtual_controller(config, Faults())


def test_a_rig_tells_whether_it_tells_anything():
    assert RigConfig(force=1e5).told
    assert not RigConfig().told
