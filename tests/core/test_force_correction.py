"""Force correction (Eq. 11) against the filter it must be."""

import numpy as np
import pytest
from scipy.signal import lfilter

from bmd_rths_core.config import Config
from bmd_rths_core.force_correction import ForceCorrection, ForceCorrectionConfig
from bmd_rths_core.numerical_substructure import NumericalSubstructure


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
