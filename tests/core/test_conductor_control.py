"""The conductor of an interface control: a step closes with the force and the measurement."""

import numpy as np
import pytest

from bmd_rths_core.loop.control_stage import ControlStage
from bmd_rths_core.loop.states import Outcome
from tests.core.test_conductor import Bench, measured


@pytest.mark.parametrize("order", ["force first", "measurement first"])
def test_step_of_an_interface_control_closes_when_force_and_measurement_are_in(order):
    bench = Bench(lockstep=True, closure=None)
    bench.numerical.takes_feedback = False
    bench.run(steps=1)
    conductor = bench.conductor
    for step in range(3):
        begun = len(bench.begun)
        for is_force in (order == "force first", order != "force first"):
            conductor.poll(bench.now)
            assert len(bench.begun) == begun
            if is_force:
                conductor.shear(step, 1.0, bench.now)
            else:
                conductor.measured(measured(step), bench.now)
        conductor.poll(bench.now)
        assert len(bench.begun) == begun + 1
    assert [m.step for m in bench.numerical.learnt] == [0, 1, 2]


def test_measurement_that_is_lost_misses_the_deadline_and_the_next_step_closes():
    bench = Bench(closure=0.001)
    bench.numerical.takes_feedback = False
    bench.run(steps=1)
    for step in range(5):
        if step != 2:
            bench.conductor.measured(measured(step), bench.now)
        bench.run(steps=step + 2)
    assert bench.timing.missed_steps == (2,)


def test_feedback_needs_no_measurement():
    bench = Bench(steps=3, lockstep=True)
    bench.run()
    assert bench.ended == (Outcome.FINISHED, "end of the ground motion")


def test_late_measurement_is_not_passed_on_to_the_control():
    stage = ControlStage(learnt := Learner(), np.zeros(5))
    for step in range(3):
        stage.step(0.0, 0.0)
        stage.learn(measured(step - 1))
        stage.learn(measured(step))
    assert learnt.steps == [0, 1, 2]


class Learner:
    """An interface control that only writes down what it learns."""

    preview = 1

    def __init__(self):
        self.steps = []

    def step(self, ground_acceleration):
        return None

    def learn(self, measurement):
        self.steps.append(measurement.step)
