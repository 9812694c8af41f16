"""What a record says about its loop, its clock and its table."""

import numpy as np
import pytest

from bmd_rths_core.analysis.assumptions import assumptions
from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.config import Config
from bmd_rths_core.record import RunRecord, TimingStatistics, empty_signals
from bmd_rths_core.report.wording import assumption, ending


def record_of(steps=1000, known=True, **changes):
    signals = empty_signals(steps, 2)
    if known:
        signals["desired_acceleration"] = np.zeros(steps)
    return RunRecord(0.005, **signals, configuration=Config().as_mapping(), motion={"name": "sine"}, **changes)


def timing(missed=0, late=0):
    return TimingStatistics(missed, 1, (), late, {"p50": 1.0, "p99": 2.0, "max": 3.0})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "stable"),
        ({"outcome": "stopped"}, "stable"),
        ({"outcome": "limit", "reason": "safety.stability_limit [1] passed at step 9"}, "unstable"),
        ({"outcome": "limit", "reason": "table_driver: safety.force_limit [N] passed at step 9"}, "limit"),
        ({"outcome": "failed"}, "failed"),
        ({"steps": 0}, "no data"),
        ({"steps": 0, "outcome": "failed"}, "no data"),
        ({"known": False}, "no data"),
    ],
)
def test_every_way_to_end_has_its_own_word(changes, words):
    assert record_of(**changes).stability == words


@pytest.mark.parametrize(
    ("missed", "late", "kept"),
    [(0, 0, True), (10, 0, True), (11, 0, False), (0, 10, True), (0, 11, False), (8, 8, True)],
)
def test_more_than_one_late_step_in_a_hundred_is_no_real_time(missed, late, kept):
    record = record_of(timing=timing(missed, late))
    assert record.kept_time is kept
    told = ending(record)
    assert (told == "Finished: the whole ground motion was run.") is kept
    if not kept:
        assert told == (
            "Finished: the whole ground motion was run, but not in real time: "
            f"{missed} of 1000 deadlines were missed and {late} steps began late, 1.1 % where 1 % is allowed."
        )


def test_run_without_a_clock_has_none_to_keep():
    assert record_of().kept_time is None
    assert record_of(steps=0, timing=timing()).kept_time is None
    assert ending(record_of()) == "Finished: the whole ground motion was run."


@pytest.mark.parametrize(
    ("told", "name"), [(None, "simulated"), ("simulated", "simulated"), ("lab", "lab"), ("", "unknown")]
)
def test_table_of_somebody_else_assumes_nothing_of_the_simulated_one(told, name):
    record = record_of(told_controller=told)
    assert record.controller == name
    assert bool(assumptions(Config(), record.controller)) is (name == "simulated")
    assert analysed(record).quality.specimen == ("simulated" if name == "simulated" else None)


def test_what_moved_the_table_of_a_cut_recording_is_not_known():
    record = record_of(outcome="cut", reason="the recording has no end")
    assert record.controller == "unknown"
    analysis = analysed(record)
    assert assumption(analysis) == "What moved the table is not known: the recording has no end."
    assert (analysis.quality.specimen, analysis.quality.clean.origin) == (None, "estimated")
