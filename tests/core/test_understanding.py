"""What `check` tells, against closed forms, and the ground motion as it will be run."""

import numpy as np
import pytest

from bmd_rths_core.analysis.preflight import predict_test
from bmd_rths_core.analysis.understanding import table_delay, understanding
from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.ground_motion import GroundMotion
from bmd_rths_core.ground_motion.as_run import as_run, ground_motion_as_run, in_words, peaks_of
from bmd_rths_core.ground_motion.config import GroundMotionConfig
from tests.core.test_mistakes import RIG


def sine(amplitude=2.0, frequency=1.0, step=0.005):
    """Whole periods of a cosine: velocity and displacement have closed forms."""
    time = step * np.arange(round(4 / frequency / step) + 1)
    return GroundMotion("sine", step, amplitude * np.cos(2 * np.pi * frequency * time), "test", "0" * 64)


def test_peaks_of_a_cosine_are_its_closed_forms():
    peaks = peaks_of(sine())
    omega = 2 * np.pi
    assert peaks.acceleration == 2.0
    assert peaks.velocity == pytest.approx(2.0 / omega, rel=1e-3)
    assert peaks.displacement == pytest.approx(2 * 2.0 / omega**2, rel=1e-3)
    assert peaks.last_velocity == pytest.approx(0.0, abs=1e-6)
    assert peaks.last_displacement == pytest.approx(0.0, abs=1e-4)


def test_the_default_scales_a_record_and_says_so():
    """1 m/s² is asked for by default: half of this record."""
    ran = as_run(sine(), GroundMotionConfig(), 0.005)
    assert ran.scale_factor == pytest.approx(0.5)
    assert ran.scaled.acceleration == 1.0
    assert ran.scaled.velocity == pytest.approx(0.5 * ran.recorded.velocity)
    assert in_words(ran).startswith("ground motion sine scaled by 0.5: PGA 2 to 1 m/s², PGV 0.159 m/s, PGD 50.7 mm")
    whole = as_run(sine(), GroundMotionConfig(peak_acceleration=0.0), 0.005)
    assert whole.scale_factor == 1.0
    assert "as recorded, PGA 2 m/s²" in in_words(whole)


def test_the_delay_of_a_table_is_that_of_its_model():
    perfect = {"simulated_table__dynamics": "perfect", "simulated_table__command_delay": 0.012}
    assert table_delay(Config().changed(**perfect)) == pytest.approx(0.012)
    servo = Config().changed(simulated_table__dynamics="servo", simulated_table__servo_damping_ratio=0.7)
    assert table_delay(servo) == pytest.approx(1 / 43.08 + 2 * 0.7 / 134.8, rel=0.15)  # at low frequency


def test_check_tells_what_was_understood():
    config = config_from_mapping(RIG)
    ran = ground_motion_as_run(config.ground_motion, config.run.time_step)
    told = understanding(config, ran, None)
    specimen = told["specimen"]
    assert (specimen["floors"], specimen["mass_kg"], specimen["given_by"]) == (2, 1900.0, "stories")
    assert np.array(specimen["frequencies_hz"]) * specimen["periods_s"] == pytest.approx(1.0)
    assert specimen["damping_ratios"] == pytest.approx([0.02, 0.02])
    assert len(told["whole_building_hz"]) == 5
    modes = config.specimen.building().modes(), config.numerical_substructure.building().modes()
    ours, theirs = (entry.effective_masses[0] for entry in modes)
    assert told["mass_ratio"] == pytest.approx(ours / (ours + theirs))
    assert told["capacity"][0] == {
        "quantity": "displacement",
        "unit": "m",
        "capacity": 0.1,
        "interlock": 0.1,
        "limit": 0.092,
    }
    assert told["ground_motion"]["scale_factor"] == pytest.approx(1.0 / told["ground_motion"]["recorded"]["pga_m_s2"])
    assert "predicted" not in told


def test_check_predicts_the_peaks_and_warns_of_a_lead_that_is_not_the_delay():
    config = config_from_mapping({**RIG, "ground_motion": {"duration": 3.0}}).changed(command_shaper__lead_time=0.05)
    ran = ground_motion_as_run(config.ground_motion, config.run.time_step)
    prediction = predict_test(config, ran.motion)
    told = understanding(config, ran, prediction)
    assert told["predicted"]["displacement_m"] == prediction.peaks.displacement
    assert told["ground_motion"]["stroke_needed_m"] == prediction.peaks.displacement
    assert told["warnings"][0].startswith("command_shaper.lead_time: the compensator leads by 50.0 ms, the table model")
