"""A loop that needs too long for its time step is refused before its table moves, or warned of."""

from itertools import count

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import PROGRESS_PERIOD
from bmd_rths_nodes.cli import preflight


@pytest.fixture
def checked(monkeypatch, capsys):
    """Check a short test in which the processor needs a share of a time step for each step."""

    def check(share, **changes):
        config = Config().changed(ground_motion__duration=4.0, ground_motion__free_vibration=0.0, **changes)
        cost = share * config.run.time_step * PROGRESS_PERIOD
        clock = count()
        monkeypatch.setattr(preflight.time, "thread_time", lambda: next(clock) * cost)
        found = preflight.checked(config, select_ground_motion(config.ground_motion, config.run.time_step))
        return found, capsys.readouterr().err

    return check


def test_a_loop_that_leaves_time_is_not_spoken_of(checked):
    found, errors = checked(0.5)
    assert found.cleared
    assert "computing a step" not in errors


def test_a_loop_that_leaves_little_is_warned_of(checked):
    found, errors = checked(0.7)
    assert found.cleared
    assert "warning: computing a step takes 70 % of run.time_step, 0.005 s; " in errors


def test_a_loop_that_leaves_too_little_is_refused(checked):
    with pytest.raises(InputError, match=r"computing a step takes 90 % of run.time_step, 0.005 s; at most 80 % is"):
        checked(0.9)
    found, _ = checked(0.9, run__preflight="override")
    assert not found.cleared


def test_lockstep_takes_the_time_it_needs(checked):
    found, errors = checked(2.0, run__lockstep=True)
    assert found.cleared
    assert "computing a step" not in errors
