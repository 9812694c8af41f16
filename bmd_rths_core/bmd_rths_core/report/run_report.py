"""Everything a report shows of one run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.analysis import RunAnalysis
from bmd_rths_core.report.energy import EnergyHistory, energy_history
from bmd_rths_core.report.forces import InterfaceForces, interface_forces
from bmd_rths_core.report.hysteresis import Hysteresis, numerical_loops, specimen_loops
from bmd_rths_core.report.numerical_motion import NumericalMotion, numerical_motion
from bmd_rths_core.report.responses import FloorResponses, floor_responses
from bmd_rths_core.report.timing import StepTiming
from bmd_rths_core.report.tracking import (
    FloorTransfer,
    TableFrequencies,
    TrackingHistory,
    floor_transfer,
    table_frequencies,
    tracking_history,
)
from bmd_rths_core.report.whole_samples import strong_motion

FloatArray = NDArray[np.float64]
T = TypeVar("T")

#: Fewer steps than this make no history.
_LEAST_STEPS = 3


@dataclass(frozen=True)
class RunReport:
    """One run. A part that cannot be shown is the reason why, in words.

    Parameters
    ----------
    analysis : RunAnalysis
        The run and its errors.
    motion : NumericalMotion
        The numerical substructure.
    responses, tracking, frequencies, transfer, forces, numerical_stories, specimen_stories, energy, timing
        What the figures show, or why there is none.
    """

    analysis: RunAnalysis
    motion: NumericalMotion
    responses: FloorResponses | str
    tracking: TrackingHistory | str
    frequencies: TableFrequencies | str
    transfer: FloorTransfer | str
    forces: InterfaceForces | str
    numerical_stories: Hysteresis | str
    specimen_stories: Hysteresis | str
    energy: EnergyHistory | str
    timing: StepTiming | str


def run_report(analysis: RunAnalysis, timing: StepTiming | str) -> RunReport:
    """Compute what the figures of a run show.

    Parameters
    ----------
    analysis : RunAnalysis
        The run; of any length, with any gaps.
    timing : StepTiming or str
        Its timing, or why it has none.
    """
    record, config, reference, lower = analysis.record, analysis.config, analysis.reference, analysis.lower
    motion = numerical_motion(record, config)
    strong = strong_motion(record.ground_acceleration, record.time_step)
    history = (
        "" if record.steps >= _LEAST_STEPS else f"a history needs {_LEAST_STEPS} steps, the run has {record.steps}"
    )
    force = history or _missing(record.required_force, "forces")
    table = history or _missing(record.table_acceleration, "acceleration of the table")
    floors = table or _floors_missing(record, config)
    return RunReport(
        analysis,
        motion,
        responses=_part(history, lambda: floor_responses(record, reference, motion, strong)),
        tracking=_part(table, lambda: tracking_history(record, strong)),
        frequencies=_part(table, lambda: table_frequencies(record)),
        transfer=_part(floors, lambda: floor_transfer(record, reference, lower)),
        forces=_part(force, lambda: interface_forces(record, config.force_correction.feedback_scale, strong)),
        numerical_stories=_part(history, lambda: numerical_loops(motion, config)),
        specimen_stories=_part(floors, lambda: specimen_loops(record, config)),
        energy=_part(history, lambda: energy_history(motion, config)),
        timing=timing,
    )


def _part(reason: str, compute: Callable[[], T]) -> T | str:
    """Return a part of the report, or why there is none."""
    if reason:
        return reason
    try:
        return compute()
    except InputError as error:
        return str(error)


def _missing(signal: FloatArray, name: str) -> str:
    return "" if np.isfinite(signal).any() else f"nothing was recorded of the {name}"


def _floors_missing(record: RunRecord, config: Config) -> str:
    expected, found = len(config.specimen.masses), record.floor_accelerations.shape[1]
    if found != expected:
        return f"the record has {found} measured floors, the specimen {expected}"
    return next(
        (reason for i in range(found) if (reason := _missing(record.floor_accelerations[:, i], f"floor {i + 1}"))), ""
    )
