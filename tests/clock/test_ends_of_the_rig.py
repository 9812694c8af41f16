"""How benchmarks/by_the_clock.py counts tests that were over when their abort came."""

import math
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import click
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.record_bag import write_record

RIG = SimpleNamespace(**runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "by_the_clock.py")))


@pytest.mark.parametrize(
    ("ending", "outcome", "aborted", "before", "ignored"),
    [
        ("end", "finished", math.inf, False, False),
        ("end", "failed", math.inf, True, False),
        ("driver", "limit", math.inf, False, False),
        ("driver", "failed", math.inf, True, False),
        ("indicator", "finished", math.inf, False, True),
        ("ctrl-c", "stopped", 9.9, False, False),
        ("ctrl-c", "failed", 12.0, True, False),  # on the way to rest, or while the result is analysed
        ("ctrl-c", "limit", 9.9, True, False),  # before Ctrl-C had reached the table driver
        ("ctrl-c", "finished", 8.0, False, True),
        ("stall", "finished", 9.0, False, False),
        ("stall", "finished", 10.1, True, False),
        ("stall", "failed", math.inf, True, False),  # no process was left
    ],
)
def test_whether_an_abort_came_in_time(ending, outcome, aborted, before, ignored):
    assert RIG.came_to(ending, outcome, aborted, last=10.0) == (before, ignored)


def result(**changes):
    still = RIG.Run("stopped", 0.0, 0.0, 100.0, 5.0, 0.0, 0.0, 0.1, 0.01, 0, 100)
    return still._replace(**changes)


def test_no_test_is_missing_in_the_counts():
    tests = [result(), result(ended_before=True), result(ignored=True), result(ended_before=True, velocity=0.1)]
    assert RIG.counts(tests) == "4 tests: 2 in time, 2 ended before; 2 wrong"
    assert [test.wrong for test in tests] == [[], [], ["went on"], ["not at rest"]]
    assert "ended before" in RIG.line("", tests[1])


def test_ctrl_c_in_the_analysis_leaves_the_word_to_the_bag(tmp_path):
    config = Config().changed(ground_motion__duration=0.2)
    record = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    write_record(record, tmp_path / "bag")
    told = RIG.told_by("", "the bag is closed\nstopped\n", "ctrl-c", tmp_path)
    assert told == {"outcome": "finished", "reason": record.reason, "steps": record.steps, "missed_deadlines": 0}
    for errors, ending in (("error: the bag was not closed\n", "ctrl-c"), ("stopped\n", "stall")):
        with pytest.raises(click.ClickException, match="run told nothing"):
            RIG.told_by("", errors, ending, tmp_path)


def test_a_process_that_has_ended_has_nothing_to_hold_up():
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    assert RIG.running(child.pid, "python") == []
