"""A numerical substructure that needs too long is warned of or refused, and it is said how many sub-steps would do."""

import time

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.integration.substeps import longest_integration, substeps_for
from bmd_rths_nodes.cli import preflight
from bmd_rths_nodes.doctor import integration
from bmd_rths_nodes.doctor.finding import GOOD, PROBLEM, WARNING

STEP = Config().run.time_step


@pytest.mark.parametrize(
    ("substeps", "steps", "level"),
    [(1, 0.59, GOOD), (1, 0.61, WARNING), (1, 0.81, PROBLEM), (5, 2.9, GOOD), (5, 3.1, WARNING), (5, 4.1, PROBLEM),
     (2, 0.74, GOOD), (2, 0.76, WARNING), (2, 1.01, PROBLEM)],
)  # fmt: skip
def test_levels(substeps, steps, level):
    config = Config().changed(numerical_substructure__substeps=substeps)
    assert integration.judged(config, steps * STEP)[0] == level


def test_the_hand_over_is_the_longest_an_integration_may_take():
    assert longest_integration(10, STEP) == pytest.approx(0.8 * 10 * STEP)
    assert longest_integration(4, STEP) == pytest.approx(3 * STEP)
    assert longest_integration(1, STEP) == pytest.approx(0.8 * STEP)


def test_how_many_substeps_would_do():
    assert substeps_for(0.5 * STEP, STEP, 0.1) == 1
    assert substeps_for(1.4 * STEP, STEP, 0.1) == 3
    assert substeps_for(2.9 * STEP, STEP, 0.1) == 5
    assert substeps_for(13.0 * STEP, STEP, 0.1) is None
    assert substeps_for(3.0 * STEP, STEP, 4.5 * STEP) is None
    _, found, advice = integration.judged(Config(), 2.9 * STEP)
    assert found == "one integration takes 14.5 ms, 290 % of a step of 0.005 s; at most 80 % is allowed"
    assert advice == "numerical_substructure.substeps=5 leaves it enough time"


def test_the_integration_is_measured(monkeypatch):
    class Slow:
        def reset(self):
            pass

        def step(self, ground, force):
            end = time.thread_time() + 2e-3
            while time.thread_time() < end:
                pass

    monkeypatch.setattr(integration, "make_numerical_substructure", lambda config: Slow())
    monkeypatch.setattr(integration, "_LONGEST", 0.0)
    assert 2e-3 <= integration.integration_time(Config()) < 4e-3


@pytest.fixture
def checked(monkeypatch, capsys):
    """Check a short test of a loop and of an integration that take so many steps each."""

    def check(loop, steps, substeps, **changes):
        config = Config().changed(
            ground_motion__duration=1.0,
            ground_motion__free_vibration=0.0,
            force_correction__feedback_scale=0.3,
            numerical_substructure__substeps=substeps,
            **changes,
        )
        whole = loop + steps / substeps
        monkeypatch.setattr(preflight, "_cost_of_a_step", lambda marks: whole * STEP)
        monkeypatch.setattr(integration, "integration_time", lambda config: steps * STEP)
        found = preflight.checked(config, select_ground_motion(config.ground_motion, STEP))
        return found, capsys.readouterr().err

    return check


def test_what_is_computed_beside_the_loop_is_not_its_time(checked):
    found, errors = checked(0.1, 1.4, 3)
    assert found.cleared
    assert "warning" not in errors


def test_an_integration_that_leaves_little_is_warned_of(checked):
    found, errors = checked(0.1, 1.8, 3)
    assert found.cleared
    assert "warning: numerical_substructure.substeps: one integration takes 9 ms, 60 % of 3 steps of 0.005 s" in errors


def test_an_integration_that_leaves_too_little_is_refused(checked):
    with pytest.raises(
        InputError, match=r"numerical_substructure.substeps: one integration .* at most 67 % is allowed"
    ):
        checked(0.1, 2.1, 3)
    found, _ = checked(0.1, 2.1, 3, run__lockstep=True)
    assert found.cleared


def test_without_substeps_it_is_said_how_many_would_do(checked):
    with pytest.raises(InputError, match=r"takes 160 % .*; without its integration .* 20 %: .*substeps=3 would do"):
        checked(0.2, 1.4, 1)
    with pytest.raises(InputError, match=r"takes 170 % .* is allowed; fewer stories"):
        checked(0.7, 1.0, 1)


def test_one_processor_is_not_enough_for_two_things_at_a_time(checked, monkeypatch):
    monkeypatch.setattr(preflight.os, "sched_getaffinity", lambda process: {0})
    with pytest.raises(InputError, match=r"substeps: integrates beside the loop, and there is one processor; two are"):
        checked(0.1, 1.0, 3)
    found, _ = checked(0.1, 0.1, 1)
    assert found.cleared
