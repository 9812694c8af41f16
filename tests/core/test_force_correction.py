"""Force correction (Eq. 11) against the filter it must be."""

import numpy as np
import pytest
from scipy.signal import lfilter

from bmd_rths_core.analysis.metrics import reference_of
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import GroundMotionConfig, select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.discrete import configured_mass_ratio
from bmd_rths_core.stages.force_correction import ForceCorrection, ForceCorrectionConfig
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructure
from tests.conftest import SERVO_TABLE


def test_unbalanced_force_is_subtracted_with_the_gain():
    stage = ForceCorrection(ForceCorrectionConfig(gain=0.25), active=True)
    # f = 100 N measured, 140 N required: f_c = 40 N, a quarter of it is corrected.
    assert stage.step(required_force=140.0, interface_force=100.0) == 90.0


def test_inactive_correction_feeds_the_shear_back_bit_for_bit():
    stage = ForceCorrection(ForceCorrectionConfig(gain=1.0), active=False)
    assert stage.step(required_force=1e9, interface_force=0.1) == 0.1


@pytest.mark.parametrize("gain", [0.0, 0.5, 0.9])
def test_correction_in_the_loop_is_the_documented_filter(gain):
    """With the integration that balances Eq. 4, the stage is (1 + g) / (1 + g z⁻¹) from measured to fed-back shear."""
    measured = np.random.default_rng(0).normal(size=300) * 1000.0
    substructure = NumericalSubstructure(Config().numerical_substructure, 0.005)
    stage = ForceCorrection(ForceCorrectionConfig(gain=gain), active=True)
    fed_back = [0.0]
    for shear in measured:
        required = substructure.step(0.0, fed_back[-1]).required_force
        fed_back.append(stage.step(required, shear))
    assert fed_back[1:] == pytest.approx(lfilter([1.0 + gain], [1.0, gain], measured), abs=1e-6)


def test_scaled_shear_is_corrected_to_the_force_the_substructure_requires():
    stage = ForceCorrection(ForceCorrectionConfig(gain=0.25, feedback_scale=0.5), active=True)
    # 50 N of 100 N are fed back; 70 N required: f_c = 20 N.
    assert stage.step(required_force=70.0, interface_force=100.0) == 45.0


@pytest.mark.parametrize("scheme", ["uc", "fc", "plc", "plc_fc"])
def test_feedback_scale_is_a_lighter_specimen(scheme):
    """A share s of the shear is that of s times the mass, stiffness and damping, on a table it does not move."""
    whole = Config().changed(run__scheme=scheme, force_correction__feedback_scale=0.3, **SERVO_TABLE)
    building = whole.specimen.building().scaled(0.3)
    light = Config().changed(
        run__scheme=scheme,
        specimen__masses=building.masses,
        specimen__stiffnesses=building.stiffnesses,
        specimen__damping_coefficients=building.damping_coefficients,
        **SERVO_TABLE,
    )
    assert configured_mass_ratio(whole) == pytest.approx(configured_mass_ratio(light), rel=1e-12)
    motion = select_ground_motion(GroundMotionConfig(duration=4.0), 0.005)
    runs = [RthsLoop(config, motion).run() for config in (whole, light)]
    assert runs[0].desired_acceleration == pytest.approx(runs[1].desired_acceleration, rel=1e-9, abs=1e-9)
    references = [reference_of(run, config) for run, config in zip(runs, (whole, light), strict=True)]
    assert references[0] == pytest.approx(references[1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("scale", [0.0, -0.1, 1.1])
def test_feedback_scale_out_of_range_is_refused(scale):
    with pytest.raises(InputError, match=r"force_correction.feedback_scale.*> 0 and <= 1 is required"):
        ForceCorrectionConfig(feedback_scale=scale)
