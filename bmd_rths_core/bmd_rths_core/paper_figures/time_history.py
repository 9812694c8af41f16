"""Acceleration of the superstructure in a test and in the benchmark (Figure 13)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.metrics import reference_of, rmse_percent
from bmd_rths_core.compensators.schemes import Scheme
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.paper_figures.stated_value import Comparison

FloatArray = NDArray[np.float64]

#: RMSE of the superstructure under Parkfield with PLC + FC [%]: Table 3 of Chen et al. (2020).
PAPER_RMSE = 48.84

#: Length of the strong motion that is shown by itself [s].
_STRONG_MOTION = 5.0


@dataclass(frozen=True)
class TimeHistory:
    """What Figure 13 shows.

    Parameters
    ----------
    number : int
        Number of the figure.
    title : str
        What is shown.
    motion : str
        Name of the ground motion.
    is_parkfield : bool
        True when the ground motion is the one of the paper's figure.
    time : ndarray, shape (N,)
        Test time [s].
    benchmark, rths : ndarray, shape (N,)
        Absolute acceleration of the superstructure in the unpartitioned building and in the test [m/s²].
    strong_motion : tuple of float
        Begin and end of the strongest part of the benchmark [s].
    rmse_percent : float
        Eq. 12 [%].
    stopped : str
        Why the test ended early, empty when it did not.
    comparisons : tuple of Comparison
        Computed numbers beside those of the paper.
    """

    number: int
    title: str
    motion: str
    is_parkfield: bool
    time: FloatArray
    benchmark: FloatArray
    rths: FloatArray
    strong_motion: tuple[float, float]
    rmse_percent: float
    stopped: str
    comparisons: tuple[Comparison, ...]


def figure_13(config: Config, progress: Callable[[float], None] | None = None) -> TimeHistory:
    """Run the test of Figure 13 in process: phase-lead compensation and force correction.

    Parameters
    ----------
    config : Config
        The simplified system with any ground motion.
    progress : callable, optional
        Called with the finished share of the work, from 0 to 1.

    Returns
    -------
    TimeHistory
        Sensors are read at the end of a step, so row k of the test stands beside row k + 1 of the benchmark.

    Raises
    ------
    InputError
        The ground motion cannot be read or used, or a limit ends the test before it has begun.
    """
    config = config.changed(run__scheme=Scheme.PLC_FC.value)
    motion = select_ground_motion(config.ground_motion, config.run.time_step)
    report = None if progress is None else (lambda steps: progress(steps / motion.steps))
    record = RthsLoop(config, motion).run(report)
    if record.steps < 3:
        raise InputError(f"Figure 13: there is no test to show: {record.reason}")
    benchmark = reference_of(record, config)[1:, -1]
    rths = record.floor_accelerations[:-1, -1]
    error = rmse_percent(benchmark, rths)
    is_parkfield = "parkf" in motion.name.lower()  # RSN30_PARKF_C05085 is the name PEER gives its file
    paper = f"{PAPER_RMSE:g} %, Table 3" if is_parkfield else "not this ground motion"
    return TimeHistory(
        number=13,
        title="Acceleration of the superstructure",
        motion=motion.name,
        is_parkfield=is_parkfield,
        time=record.sensor_time[:-1],
        benchmark=benchmark,
        rths=rths,
        strong_motion=strong_motion(benchmark, config.run.time_step),
        rmse_percent=error,
        stopped="" if record.outcome == "finished" else record.reason,
        comparisons=(Comparison(f"RMSE of the superstructure, PLC + FC, {motion.name}", error, "%", paper),),
    )


def strong_motion(acceleration: FloatArray, time_step: float) -> tuple[float, float]:
    """Return the few seconds that have the largest mean square.

    Parameters
    ----------
    acceleration : ndarray, shape (N,)
        Acceleration at the ends of steps 0 to N − 1.
    time_step : float
        Δt [s].

    Returns
    -------
    begin, end : float
        [s]. All of a record that is shorter.
    """
    length = min(round(_STRONG_MOTION / time_step), len(acceleration) - 1)
    energy = np.cumsum(acceleration**2)
    begin = int(np.argmax(energy[length:] - energy[:-length]))
    return (begin + 1) * time_step, (begin + 1 + length) * time_step
