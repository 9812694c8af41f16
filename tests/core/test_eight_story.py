"""The 8-story system: what the paper says about it, and that its loop runs where the analysis says so."""

from pathlib import Path

import pytest

from bmd_rths_core.config import load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.discrete import configured_mass_ratio, discrete_margin
from bmd_rths_core.stability.models import EQUATION_9

CONFIG = load_config(Path(__file__).parents[2] / "config" / "eight_story_bmd.yaml")


def test_configuration_has_the_numbers_of_the_paper():
    numerical = CONFIG.numerical_substructure.building()
    assert numerical.stories == 3
    assert numerical.modes().frequencies[0] == pytest.approx(35.43, rel=1e-6)
    assert numerical.modes().damping_ratios[0] == pytest.approx(0.02, rel=1e-6)
    assert configured_mass_ratio(CONFIG) == pytest.approx(0.65, abs=5e-5)
    assert CONFIG.simulated_table.sections == EQUATION_9
    assert len(CONFIG.specimen.masses) == 5


@pytest.mark.parametrize("scheme", ["uc", "fc", "plc", "plc_fc"])
def test_whole_shear_is_unstable_and_is_stopped_early(scheme):
    config = CONFIG.changed(run__scheme=scheme)
    assert closed_loop(config).spectral_radius > 1.0
    record = RthsLoop(config, select_ground_motion(config.ground_motion, 0.005)).run()
    assert record.outcome == "limit"
    assert "safety.stability_limit" in record.reason
    assert abs(record.command).max() < 0.5 * config.safety.acceleration_limit


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["uc", "fc", "plc", "plc_fc"])
def test_share_of_the_shear_below_the_margin_runs_to_the_end(scheme):
    config = CONFIG.changed(run__scheme=scheme)
    ratio = 0.8 * discrete_margin(config).allowable_mass_ratio
    scale = ratio / (1.0 - ratio) * 0.35 / 0.65
    config = config.changed(force_correction__feedback_scale=scale)
    assert configured_mass_ratio(config) == pytest.approx(ratio, rel=1e-4)
    assert closed_loop(config).spectral_radius < 1.0
    record = RthsLoop(config, select_ground_motion(config.ground_motion, 0.005)).run()
    assert (record.outcome, record.stable) == ("finished", True)
