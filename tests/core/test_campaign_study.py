"""The plan of a campaign, its ground motions, its keys, and the tables of the paper."""

import numpy as np
import pytest

from bmd_rths_core.analysis.capture import capture_of
from bmd_rths_core.analysis.metrics import run_metrics
from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.campaign.motions import read_motions
from bmd_rths_core.campaign.paper_tables import EVENTS, TABLE_2, TABLE_3, event_of, paper_mean
from bmd_rths_core.campaign.study import PIECE, Study, key_of_run, run_piece
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from tests.conftest import ground_motion_folder, needs
from tests.core.record_samples import SAMPLES

CSV = "time_s,acceleration_g\n" + "".join(f"{0.01 * i:.2f},{0.1 * np.sin(0.3 * i):.6f}\n" for i in range(60))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "Kobe").mkdir()
    (tmp_path / "Kobe" / "a.csv").write_text(CSV)
    (tmp_path / "b.csv").write_text(CSV.replace("0.01,", "0.01,-"))
    (tmp_path / "several.V2A").write_bytes(SAMPLES["GeoNet V2A"].content)
    (tmp_path / "README.md").write_text("Records\n")
    return tmp_path


def test_folder_gives_what_needs_no_guess_and_tells_the_rest(folder):
    found = read_motions(folder)
    assert [motion.motion.name for motion in found.motions] == ["a", "b"]
    assert set(found.left_out) == {"several.V2A", "README.md"}
    assert found.left_out["several.V2A"].startswith("3 components")


def test_list_names_components_and_units(folder):
    (folder / "b.json").write_bytes(SAMPLES["SimCenter JSON"].content)
    (folder / "list.txt").write_text(
        "# component, unit\n\nKobe/a.csv\nseveral.V2A, s80e\nb.json,x,gal\nel_centro_1940_ns # shipped\n"
    )
    found = read_motions(folder / "list.txt")
    assert [motion.motion.name for motion in found.motions] == ["a", "several_S80E", "b_x", "el_centro_1940_ns"]
    assert [(motion.component, motion.unit) for motion in found.motions[1:3]] == [("s80e", "from_file"), ("x", "gal")]
    assert found.left_out == {}


def test_what_files_do_not_say_is_said_once_for_all_that_need_it(folder):
    """A file that says it itself is read by what it says."""
    (folder / "numbers.txt").write_text("\n".join(str(0.1 * (i % 7)) for i in range(50)) + "\n")
    (folder / "b.json").write_bytes(SAMPLES["SimCenter JSON"].content)
    plain = read_motions(folder)
    asked = (
        Config()
        .changed(ground_motion__record_time_step=0.02, ground_motion__columns="x", ground_motion__unit="g")
        .ground_motion
    )
    found = read_motions(folder, asked)
    assert "numbers.txt" in plain.left_out
    assert {m.record for m in plain.motions} < {m.record for m in found.motions}
    (numbers,) = [m for m in found.motions if m.record.endswith("numbers.txt")]
    assert (numbers.motion.time_step, numbers.unit, numbers.columns) == (0.02, "g", "x")
    as_stated = [[m[:3] for m in read.motions if m.record.endswith("a.csv")] for read in (plain, found)]
    assert as_stated[0] == as_stated[1]
    config = Config().changed(ground_motion__duration=0.2)
    study = Study(config, [numbers], ["uc"], {})
    (piece,) = study.pieces()
    (finished,) = run_piece(piece)
    assert finished.result["outcome"] == "finished"


def test_one_record_is_a_campaign_too(folder):
    assert [motion.motion.name for motion in read_motions(folder / "Kobe" / "a.csv").motions] == ["a"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a.csv,x,g,more\n", "line 1: 'a.csv,x,g,more'; file[,component[,unit]] is required"),
        ("Kobe/a.csv\nnone.csv\n", "line 2: .*none.csv"),
        ("b.csv\nKobe/a.csv\nb.csv, # again\n", "line 3: 'b.csv, # again' stands in line 1 already"),
        ("several.V2A\n", "line 1: .*3 components"),
        ("# nothing\n", "no ground motion"),
    ],
)
def test_wrong_list_is_refused_with_its_line(folder, text, problem):
    (folder / "list.txt").write_text(text)
    with pytest.raises(InputError, match=problem.replace("[", r"\[")):
        read_motions(folder / "list.txt")


def test_results_are_those_of_single_runs(folder):
    study = Study(Config(), read_motions(folder).motions, ["uc", "plc_fc"], {"force_correction.feedback_scale": [0.4]})
    results = [finished.result for piece in study.pieces() for finished in run_piece(piece)]
    assert [(r["motion"], r["scheme"]) for r in results] == [("a", "uc"), ("b", "uc"), ("a", "plc_fc"), ("b", "plc_fc")]
    for result in results:
        changes = {"run__scheme": result["scheme"], "ground_motion__record": result["file"]}
        config = Config().changed(**changes, force_correction__feedback_scale=0.4)
        record = RthsLoop(config, select_ground_motion(config.ground_motion, 0.005)).run()
        metrics, quality = run_metrics(record), analysed(record, capture=False).quality
        assert result["rmse_percent"] == pytest.approx(metrics.rmse_percent, rel=1e-9)
        assert result["tracking_delay_ms"] == pytest.approx(metrics.tracking_delay_ms, rel=1e-9)
        assert result["rmse_true_percent"] == pytest.approx(quality.rmse_true_percent, rel=1e-9)
        assert result["rmse_clean_percent"] == pytest.approx(quality.rmse_clean_percent, rel=1e-9)
        assert result["noise_floor_percent"]["substructure"] is None
        assert result["tracking_error_percent"] == pytest.approx(quality.tracking.error_percent, rel=1e-9)
        assert result["delay_ms"] == pytest.approx(quality.tracking.delay_ms, rel=1e-9)
        assert (result["capture"], result["verdict"]) == ({"substructure": None, "superstructure": None}, "red")
        assert (result["stable"], result["engine"]) == (True, "linear")
        assert result["variation"] == {"force_correction.feedback_scale": 0.4}
        assert result["event"] == ("Kobe" if result["motion"] == "a" else None)


def test_capture_is_that_of_single_runs_and_part_of_what_a_run_is(folder):
    motions = read_motions(folder).motions
    without, study = (Study(Config(), motions, ["uc"], capture=capture) for capture in (False, True))
    results = [finished.result for piece in study.pieces() for finished in run_piece(piece)]
    for result in results:
        config = Config().changed(run__scheme="uc", ground_motion__record=result["file"])
        single = capture_of(config, select_ground_motion(config.ground_motion, 0.005))
        assert result["capture"] == pytest.approx(single._asdict(), rel=1e-9)
    keys = [{run.key for piece in each.pieces() for run in piece.runs} for each in (without, study)]
    assert not keys[0] & keys[1]


def test_unstable_runs_have_no_errors(folder):
    slow = Config().changed(safety__ramp_acceleration=0.1)
    study = Study(slow, read_motions(folder).motions, ["uc"], {"safety.acceleration_limit": [0.1]})
    for finished in run_piece(next(study.pieces())):
        assert (finished.result["stable"], finished.result["outcome"]) == (False, "limit")
        assert "safety.acceleration_limit" in finished.result["reason"]
        assert set(finished.result["rmse_percent"].values()) == {None}


def test_study_is_every_combination_once(folder):
    motions = read_motions(folder).motions * (PIECE + 1)
    vary = {"run.seed": [1, 2, 3], "force_correction.gain": [0.2, 0.4]}
    study = Study(Config(), motions[: PIECE + 1], ["uc", "fc"], vary)
    pieces = list(study.pieces())
    assert len(pieces) == 12
    assert study.size == sum(len(piece.runs) for piece in pieces) == 3 * 2 * 2 * (PIECE + 1)
    assert {tuple(piece.variation.values()) for piece in pieces} == {(s, g) for s in (1, 2, 3) for g in (0.2, 0.4)}
    assert all(piece.config.run.seed == piece.variation["run.seed"] for piece in pieces)


def keys(config, motions, **vary):
    pieces = Study(config, motions, ["uc", "fc"], {name.replace("__", "."): v for name, v in vary.items()}).pieces()
    return [run.key for piece in pieces for run in piece.runs]


def test_key_is_what_is_run_and_not_where_it_is(folder, tmp_path_factory):
    motions = read_motions(folder).motions
    first = keys(Config(), motions)
    assert len(set(first)) == 4
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "c.csv").write_text(CSV)
    assert set(keys(Config(), read_motions(elsewhere).motions)) == {first[0], first[2]}
    assert not set(first) & set(keys(Config().changed(run__seed=1), motions))
    assert not set(first) & set(keys(Config().changed(ground_motion__peak_acceleration=2.0), motions))
    assert set(keys(Config(), motions, run__seed=[0, 1])) > set(first)


@pytest.mark.parametrize(
    ("vary", "problem"),
    [
        ({"run.scheme": ["uc"]}, "--vary run.scheme: is varied by --schemes"),
        ({"ground_motion.record": ["x"]}, "--vary ground_motion.record: is varied by --motions"),
        ({"run.sead": [1]}, "--vary run.sead=1: run.sead: unknown parameter"),
        ({"specimen.masses": [[1.0, 2.0], [0.0, 1.0]]}, "--vary specimen.masses=.*0"),
    ],
)
def test_wrong_variation_is_refused(folder, vary, problem):
    with pytest.raises(InputError, match=problem):
        Study(Config(), read_motions(folder).motions, ["uc"], vary)


def test_tables_have_the_means_of_the_paper_and_its_unstable_tests():
    """Means worked out by hand from the printed tables."""
    for table, means in ((TABLE_2, (90.24, 84.00, 62.17, 59.97)), (TABLE_3, (61.11, 54.18, 52.40, 51.03))):
        assert len(table) == 13
        found = [paper_mean(table, scheme) for scheme in ("uc", "fc", "plc", "plc_fc")]
        assert found == pytest.approx(means, abs=0.005)
        assert [name for name, row in table.items() if None in row.values()] == ["Christchurch"]


@pytest.mark.parametrize(
    ("path", "event"),
    [
        ("records/Morgan_Hill/RSN471.json", "Morgan Hill"),
        ("Taipei/TAP017-E.AT2", "Taipei"),
        ("RSN1106_KOBE_KJM000.AT2", "Kobe"),
        ("RSN8123_CCHURCH_REHSS88E.AT2", "Christchurch"),
        ("el_centro_1940_ns", "El Centro"),
        ("records/Chi-Chi/TCU052-N.AT2", "Chi-Chi"),
        ("records/unknown.AT2", None),
    ],
)
def test_event_is_recognised_by_folder_or_file(path, event):
    assert event_of(path) == event


@needs(ground_motion_folder())
def test_real_records_stand_for_every_event_of_the_paper():
    assert {event_of(path.as_posix()) for path in ground_motion_folder().glob("*/*")} >= set(EVENTS)


def test_key_says_which_engine_and_is_found_again_from_the_run(folder):
    motions = read_motions(folder).motions
    in_process, on_ros = (next(Study(Config(), motions, ["uc"], engine=engine).pieces()) for engine in ("", "ros"))
    assert not {run.key for run in in_process.runs} & {run.key for run in on_ros.runs}
    for piece, engine in ((in_process, ""), (on_ros, "ros")):
        for run in piece.runs:
            motion = piece.motions[run.motion]
            config = Config().changed(run__scheme="uc", ground_motion__record=motion.record)
            assert key_of_run(config, motion.motion.sha256, engine) == run.key
