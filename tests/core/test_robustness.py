"""Plants that are drawn: what they are, that they are drawn again alike, and what a study of them says."""

import dataclasses

import numpy as np
import pytest

from bmd_rths_core.campaign.motions import CampaignMotion
from bmd_rths_core.campaign.robustness import RobustnessStudy, distributions, drawn_plant, identified_plant
from bmd_rths_core.campaign.study import run_piece
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE, ONLY
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.stability.models import simulated_table
from tests.core.mpic_parts import motion
from tests.core.test_joint_model import CONFIGS

EIGHT = load_config(CONFIGS / "eight_story_bmd.yaml")


def frequency_response(table, specimen, omega):
    plant = table.plant(specimen)
    inverse = np.linalg.solve(1j * omega * np.eye(len(plant.a)) - plant.a, plant.b[:, 0])
    return plant.output[0] @ inverse + plant.feedthrough[0]


def changed(config, **values):
    return config.changed(**{f"simulated_table__{name}": value for name, value in values.items()}).simulated_table


@pytest.mark.parametrize("config", [Config(), EIGHT], ids=["servo", "sections"])
def test_gain_and_further_mode_of_the_simulated_table(config):
    specimen = config.specimen.building()
    built, plain = changed(config, command_gain=1.2, unmodelled_mode=0.3), config.simulated_table
    omega, mode = 80.0, 2.0 * np.pi * 25.0
    factor = 1.2 * (0.7 + 0.3 * mode**2 / (mode**2 - omega**2 + 2j * 0.02 * mode * omega))
    expected = factor * frequency_response(plain, specimen, omega)
    assert frequency_response(built, specimen, omega) == pytest.approx(expected, rel=1e-9)
    assert simulated_table(built, specimen).response(np.array([omega]))[0] == pytest.approx(expected, rel=1e-6)


def test_damping_of_the_simulated_specimen():
    specimen = Config().specimen.building()
    damped = changed(Config(), specimen_damping_factor=1.5).specimen(specimen)
    assert damped.damping_coefficients == pytest.approx(1.5 * np.array(specimen.damping_coefficients))


def test_drawn_plants_stay_within_their_shares_and_differ():
    draws = [drawn_plant(Config(), 0.1, np.random.default_rng(i)) for i in range(300)]
    table = Config().simulated_table
    for name in ("servo_real_pole", "servo_frequency", "command_gain", "specimen_stiffness_factor", "shear_noise"):
        ratios = np.array([draw[f"simulated_table.{name}"] for draw in draws]) / getattr(table, name)
        assert 0.9 <= ratios.min() < 0.92
        assert 1.08 < ratios.max() <= 1.1
    assert {draw["simulated_table.command_delay"] for draw in draws} == {0.0, 0.005}
    assert 60 < sum(draw["simulated_table.unmodelled_mode"] > 0.0 for draw in draws) < 140


def test_drawn_sections_keep_their_gain_and_move_their_poles():
    draw = drawn_plant(EIGHT, 0.1, np.random.default_rng(1))
    moved = np.reshape(draw["simulated_table.sections"], (-1, 6))
    rows = np.reshape(EIGHT.simulated_table.sections, (-1, 6))
    assert moved[:, 2] / moved[:, 5] == pytest.approx(rows[:, 2] / rows[:, 5])
    speeds = np.sqrt(moved[:4, 5] / rows[:4, 5])
    assert np.all((speeds > 0.9) & (speeds < 1.1))
    assert len(set(speeds.tolist())) == 4
    for before, after, speed in zip(rows, moved, speeds, strict=False):
        assert np.sort_complex(np.roots(after[3:])) == pytest.approx(speed * np.sort_complex(np.roots(before[3:])))


DEVIATIONS = {
    "identified_model__table": "interacting_servo",
    "identified_model__stiffnesses": [2.5e6, 4.9e6],
    "identified_model__damping_coefficients": [3330.0, 78.0],
    "identified_model__stiffness_deviations": [2.5e4, 4.9e4],
    "identified_model__damping_deviations": [33.3, 0.78],
    "identified_model__table_deviations": [0.02, 1.0, 1.5, 0.001, 50.0, 1e-4],
}


def test_plants_are_drawn_from_the_deviations_of_the_identified_model():
    config = Config().changed(**DEVIATIONS)
    draws = [identified_plant(config, np.random.default_rng(i)) for i in range(400)]
    table, model = config.simulated_table, config.identified_model
    expected = {"specimen_stiffness_factor": 0.01, "specimen_damping_factor": 0.01, "command_gain": 0.02}
    expected["servo_real_pole"] = 1.0 / model.servo_real_pole
    expected["platen_mass"] = 50.0 / model.platen_mass
    for name, deviation in expected.items():
        ratios = np.array([draw[f"simulated_table.{name}"] for draw in draws]) / getattr(table, name)
        assert np.std(ratios) == pytest.approx(deviation, rel=0.12), name
        assert np.mean(ratios) == pytest.approx(1.0, abs=4.0 * deviation / 20.0), name
    delays = np.array([draw["simulated_table.command_delay"] for draw in draws])
    assert (delays == 0.0).mean() == pytest.approx(0.5, abs=0.1)
    study = RobustnessStudy(
        config, [CampaignMotion("random", ONLY, FROM_FILE, motion(600))], ("uc",), 2, identified=True
    )
    assert len({run.key for piece in study.pieces() for run in piece.runs}) == 2
    with pytest.raises(InputError, match=r"identified_model.stiffness_deviations: none"):
        dataclasses.replace(study, config=Config())


def test_deviations_have_the_length_of_what_they_are_of():
    with pytest.raises(InputError, match=r"identified_model.table_deviations: 2 entries; 6 or none"):
        Config().changed(**{**DEVIATIONS, "identified_model__table_deviations": [0.1, 0.2]})


def made_study(plants, share=0.1, schemes=("uc",)):
    return RobustnessStudy(Config(), [CampaignMotion("random", ONLY, FROM_FILE, motion(600))], schemes, plants, share)


def test_a_larger_study_goes_on_with_a_smaller_one():
    few, many = ([run.key for piece in made_study(n).pieces() for run in piece.runs] for n in (2, 4))
    assert many[:2] == few
    assert len(set(many)) == 4
    assert made_study(4).size == 4


def test_results_are_those_of_the_drawn_plants():
    study = made_study(3, schemes=("uc", "plc"))
    pieces = list(study.pieces())
    results = [finished.result for piece in pieces for finished in run_piece(piece)]
    for piece, result in zip(pieces, results[::2], strict=True):
        uc = piece.config.changed(run__scheme="uc")
        assert result["spectral_radius"] == pytest.approx(closed_loop(uc).spectral_radius)
        assert result["variation"] == piece.variation
        assert uc.identified_model == Config().identified_model
    told = distributions(results)
    assert set(told) == {"uc", "plc"}
    assert told["uc"]["runs"] == 3
    errors = [result["rmse_true_percent"]["substructure"] for result in results[::2]]
    assert told["uc"]["substructure_percent"]["worst"] == max(errors)
    assert told["uc"]["substructure_percent"]["median"] == pytest.approx(np.median(errors))


def test_small_captures_are_the_bad_ones_and_plants_are_counted_by_how_their_runs_ended():
    def result(capture, radius=0.9, stability="stable"):
        keys = ("substructure", "control_layer", "superstructure")
        errors = dict.fromkeys(keys, 5.0 if stability == "stable" else None)
        captures = {"substructure": capture, "superstructure": 1.0}
        made = {"scheme": "uc", "stability": stability, "capture": captures, "spectral_radius": radius}
        return made | {
            "rmse_true_percent": errors,
            "rmse_clean_percent": errors,
            "peak_command": 1.0,
            "peak_displacement": 1.0,
        }

    bad = [result(0.4, stability=word) for word in ("unstable", "limit", "limit", "limit", "failed")]
    told = distributions([result(0.2), result(1.0), result(0.9), result(0.5, radius=1.01), *bad])
    assert told["uc"]["capture_substructure"]["worst"] == 0.2
    assert told["uc"]["capture_substructure"]["median"] == 0.9
    assert [told["uc"][name] for name in ("runs", "unstable", "limit", "failed")] == [9, 2, 3, 1]
    assert told["uc"]["spectral_radius"]["worst"] == 1.01


def test_a_share_of_one_or_more_is_refused():
    with pytest.raises(InputError, match="--share 1: is not allowed"):
        made_study(1, share=1.0)
