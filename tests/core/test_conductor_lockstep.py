"""The conductor in lockstep: a step begins when the one before has closed, and never far ahead of the recorder."""

import numpy as np
import pytest

from bmd_rths_core.loop.conductor import (
    LOCKSTEP_TIMEOUT,
    LONGEST_LEAD,
    LOOK_PERIOD,
    RECORDING_TIMEOUT,
)
from bmd_rths_core.loop.states import NodeState, Outcome
from tests.core.test_conductor import READY, Bench


def test_step_of_lockstep_begins_when_the_last_has_closed():
    bench = Bench(steps=10, lockstep=True, closure=0.3)
    bench.run()
    assert np.diff(bench.times) == pytest.approx(0.3)
    assert bench.numerical.fed_back == [0.0, *(10.0 * step for step in range(9))]
    assert bench.ended[0] is Outcome.FINISHED
    assert (bench.timing.missed_deadlines, bench.timing.late_ticks) == (0, 0)


def test_step_of_lockstep_that_does_not_close_ends_the_test():
    bench = Bench(lockstep=True, closure=lambda step: 0.001 if step < 4 else None)
    bench.run()
    assert bench.ended == (Outcome.FAILED, f"step 4 did not close within {LOCKSTEP_TIMEOUT:g} s")
    assert bench.now - bench.times[4] == pytest.approx(LOCKSTEP_TIMEOUT)


def test_older_shear_closes_no_step_of_lockstep():
    bench = Bench(lockstep=True, closure=lambda step: 0.001 if step < 4 else None)
    bench.run(steps=5)
    bench.conductor.shear(3, 1.0, bench.now)
    bench.run(until=bench.now + 1.0)
    assert len(bench.begun) == 5


class Recording(Bench):
    """Lockstep with a recorder that has told of no steps yet."""

    def __init__(self, steps):
        super().__init__(steps=steps, lockstep=True, peers=("recorder",), recorder="recorder")
        self.tell("recorder", READY)

    def wait(self, seconds, recorded):
        """Let the recorder live for a while."""
        end = self.now + seconds
        while self.now < end and self.conductor.state is not NodeState.ENDED:
            self.run(until=self.now + LOOK_PERIOD)
            self.tell("recorder", READY, recorded_steps=recorded)


def test_lockstep_does_not_run_away_from_the_recorder():
    bench = Recording(steps=LONGEST_LEAD + 300)
    bench.wait(5.0, recorded=0)
    assert bench.conductor.step == LONGEST_LEAD + 1
    bench.tell("recorder", READY, recorded_steps=150)
    bench.run(until=bench.now + 0.5)
    assert bench.conductor.step == LONGEST_LEAD + 151
    bench.tell("recorder", READY, recorded_steps=500)
    bench.run()
    assert bench.ended[0] is Outcome.FINISHED


def test_recorder_that_stays_behind_ends_lockstep():
    bench = Recording(steps=LONGEST_LEAD + 300)
    bench.wait(RECORDING_TIMEOUT + 5.0, recorded=0)
    assert bench.ended == (
        Outcome.FAILED,
        f"step {LONGEST_LEAD} was not recorded within {RECORDING_TIMEOUT:g} s",
    )
