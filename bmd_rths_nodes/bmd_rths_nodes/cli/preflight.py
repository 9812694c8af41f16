"""The pre-flight of ``bmd-rths run``: predict the test, and refuse one that must not be run."""

from __future__ import annotations

import dataclasses
import os
import statistics
import time
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.options import log, progress_bar
from bmd_rths_nodes.cli.results import without_nan

if TYPE_CHECKING:
    from bmd_rths_core.analysis.preflight import Preflight
    from bmd_rths_core.config import Config
    from bmd_rths_core.ground_motion.as_run import MotionAsRun
    from bmd_rths_core.ground_motion.motion import GroundMotion


def checked(config: Config, motion: GroundMotion) -> Preflight | None:
    """Predict a test, with a progress bar.

    Parameters
    ----------
    config : Config
        The whole configuration; ``run.preflight`` says what a problem means.
    motion : GroundMotion
        Ground motion with one sample a step.

    Returns
    -------
    Preflight or None
        None when nothing was to be predicted.

    Raises
    ------
    InputError
        The test must not be run.
    """
    if config.run.preflight == "skip":
        return None
    from bmd_rths_core.analysis.preflight import predict_test

    marks: list[tuple[int, float]] = []

    def on_progress(done: int) -> None:
        marks.append((done, time.thread_time()))
        progress.update(task, completed=done)

    with progress_bar() as progress:
        task = progress.add_task("pre-flight", total=motion.steps)
        preflight = predict_test(config, motion, on_progress)
    for problem in [] if config.run.lockstep else _too_slow(config, _cost_of_a_step(marks)):
        preflight = dataclasses.replace(preflight, problems=(*preflight.problems, problem))
    if config.run.preflight == "enforce" and not preflight.cleared:
        problems = "; ".join(preflight.problems)
        raise InputError(f"pre-flight: {problems}; --override-preflight runs it all the same")
    return preflight


def _too_slow(config: Config, cost: float) -> list[str]:
    """Return why a step, or an integration beside it, is computed too slowly; warn of what is nearly so.

    A share of each step has to be left for middleware, network and table.
    """
    from bmd_rths_core.integration.substeps import LARGEST_SHARE, WARNED_SHARE
    from bmd_rths_nodes.doctor.integration import integration_time

    substeps, time_step = config.numerical_substructure.substeps, config.run.time_step
    problems, integration = [], 0.0
    if config.compensator.control is None and (substeps > 1 or cost > WARNED_SHARE * time_step):
        integration = integration_time(config)
    if substeps > 1:
        problems = _too_slow_beside(config, integration)
        cost = max(0.0, cost - integration / substeps)  # the prediction has computed it within the loop
        integration = 0.0
    if cost > WARNED_SHARE * time_step:
        told = f"computing a step takes {100.0 * cost / time_step:.0f} % of run.time_step, {time_step:g} s"
        advice = _advice(cost - integration, integration, time_step)
        if cost > LARGEST_SHARE * time_step:
            problems.append(f"{told}; at most {100.0 * LARGEST_SHARE:g} % is allowed; {advice}")
        else:
            log(f"warning: {told}; {advice}")
    return problems


def _too_slow_beside(config: Config, integration: float) -> list[str]:
    """Return why an integration of some duration [s] is not in time beside the loop; warn where it hardly is."""
    from bmd_rths_nodes.doctor.finding import GOOD, PROBLEM
    from bmd_rths_nodes.doctor.integration import judged

    name = "numerical_substructure.substeps"
    level, found, advice = judged(config, integration)
    problems = [f"{name}: {found}; {advice}"] if level == PROBLEM else []
    if level not in (GOOD, PROBLEM):
        log(f"warning: {name}: {found}; {advice}")
    if len(os.sched_getaffinity(0)) == 1:
        problems.append(f"{name}: integrates beside the loop, and there is one processor; two are required")
    return problems


def _advice(others: float, integration: float, time_step: float) -> str:
    """Return what helps a step whose integration, which may be none of its own, and all else take so long [s]."""
    from bmd_rths_core.integration.substeps import WARNED_SHARE, substeps_for
    from bmd_rths_core.run_config import LONGEST_STEP

    enough = substeps_for(integration, time_step, LONGEST_STEP)
    if integration == 0.0 or enough is None or others > WARNED_SHARE * time_step:
        return "fewer stories, a compensator with fewer states or a longer step leave more time"
    share = 100.0 * others / time_step
    return (
        f"without its integration it would be {share:.0f} %: numerical_substructure.substeps={max(2, enough)} would do"
    )


def _cost_of_a_step(marks: Sequence[tuple[int, float]]) -> float:
    """Return the processor time of a step of loop and simulated table [s]; 0 where it is not known."""
    costs = [
        (after - before) / (done - earlier) for (earlier, before), (done, after) in pairwise(marks) if done > earlier
    ]
    return statistics.median(costs) if costs else 0.0


def in_words(config: Config, preflight: Preflight) -> str:
    """Return the line of predicted peaks beside their limits, and what was overridden.

    Parameters
    ----------
    config : Config
        The whole configuration.
    preflight : Preflight
        Its prediction.
    """
    limits, peaks, controller = config.safety, preflight.peaks, config.table.controller
    table = "the simulated table" if controller == "simulated" else f"the model in simulated_table, not {controller}"
    told = ", ".join(
        f"{name} {scale * peak:.3g} of {scale * limit:.3g}{unit}"
        for name, scale, peak, limit, unit in (
            ("displacement", 1e3, peaks.displacement, limits.displacement_limit, " mm"),
            ("velocity", 1.0, peaks.velocity, limits.velocity_limit, " m/s"),
            ("command", 1.0, peaks.acceleration, limits.acceleration_limit, " m/s²"),
            ("force", 1e-3, peaks.force, limits.force_limit, " kN"),
            ("stability indicator", 1.0, peaks.stability_indicator, limits.stability_limit, ""),
        )
    )
    overridden = "" if preflight.cleared else f"; OVERRIDDEN: {'; '.join(preflight.problems)}"
    return f"predicted for {table}: {told}{overridden}"


def tell_motion(config: Config, ran: MotionAsRun) -> None:
    """Tell how the ground motion is scaled, and what looks like a slip in the configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    ran : MotionAsRun
        Its ground motion.
    """
    from bmd_rths_core.analysis.suspicions import suspicions
    from bmd_rths_core.ground_motion.as_run import in_words as motion_in_words

    log(motion_in_words(ran))
    for warning in suspicions(config):
        log(f"warning: {warning}")


def as_mapping(preflight: Preflight) -> dict[str, Any]:
    """Return a pre-flight as plain values for ``--json``.

    Parameters
    ----------
    preflight : Preflight
        The prediction.
    """
    peaks = preflight.peaks
    told = {
        "cleared": preflight.cleared,
        "problems": list(preflight.problems),
        "verdict": preflight.verdict,
        "displacement_m": peaks.displacement,
        "velocity_m_s": peaks.velocity,
        "acceleration_m_s2": peaks.acceleration,
        "force_n": peaks.force,
        "stability_indicator": peaks.stability_indicator,
    }
    return {name: without_nan(value) for name, value in told.items()}
