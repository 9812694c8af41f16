"""What is exported of a run: every signal of the record and what follows from it, with name, unit and meaning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.reference_motion import reference_motion_of
from bmd_rths_core.analysis.run_analysis import RunAnalysis
from bmd_rths_core.analysis.specimen_shears import specimen_story_shears
from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.rest_record import REST_SIGNALS
from bmd_rths_core.signals import SIGNALS, Instant
from bmd_rths_core.table.calibration import CHANNELS, Calibration

FloatArray = NDArray[np.float64]

#: Floating point, or whole numbers.
Numbers = NDArray[Any]


@dataclass(frozen=True)
class Channel:
    """One signal of a run over its steps.

    Parameters
    ----------
    name : str
        As in the nomenclature.
    unit : str
        SI unit in ASCII, ``"1"`` for a number.
    kind : str
        Where it comes from: ``"time"``, ``"commanded"``, ``"measured"``, ``"computed"`` or ``"reference"``.
    description : str
        What it is.
    values : ndarray, shape (N,) or (N, n)
        A row a step; NaN where there is nothing.
    """

    name: str
    unit: str
    kind: str
    description: str
    values: Numbers

    def columns(self) -> list[tuple[str, Numbers]]:
        """Return the channel as columns of one number each; those of several floors or stories are numbered from 1."""
        if self.values.ndim == 1:
            return [(self.name, self.values)]
        return [(f"{self.name}_{i}", column) for i, column in enumerate(self.values.T, 1)]


@dataclass(frozen=True)
class ExportedRun:
    """One run as it is exported.

    Parameters
    ----------
    name : str
        What tells it from other runs of a file: the name of its bag.
    analysis : RunAnalysis
        The run and its errors.
    test : tuple of Channel
        N steps.
    way_to_rest : tuple of Channel
        M steps after the test; no rows where nothing was recorded.
    left_out : tuple of str
        What could not be computed, and why.
    """

    name: str
    analysis: RunAnalysis
    test: tuple[Channel, ...]
    way_to_rest: tuple[Channel, ...]
    left_out: tuple[str, ...]

    @property
    def record(self) -> RunRecord:
        """The record of the run."""
        return self.analysis.record

    def about(self) -> dict[str, str | float]:
        """Return what has to be known of the run, as text and numbers."""
        record = self.record
        return {
            "name": self.name,
            "scheme": str(record.configuration["run"]["scheme"]),
            "controller": record.controller,
            "motion": str(record.motion["name"]),
            "motion_sha256": str(record.motion["sha256"]),
            "time_step": record.time_step,
            "outcome": record.outcome,
            "reason": record.reason,
            "software": f"bmd_rths {record.versions.get('bmd_rths', 'unknown')}",
        }


#: What each signal of the record is, and where it comes from.
_MEANING = {
    "ground_acceleration": ("commanded", "ground acceleration"),
    "desired_acceleration": ("commanded", "absolute acceleration of the interface that the table has to reproduce"),
    "required_force": ("computed", "shear at the interface that balances the step"),
    "command": ("commanded", "acceleration command of the table"),
    "applied_command": ("measured", "acceleration command the table controller says it applied"),
    "table_acceleration": ("measured", "absolute acceleration of the table"),
    "table_displacement": ("measured", "displacement of the table"),
    "actuator_force": ("measured", "force of the actuator on the table"),
    "base_shear": ("measured", "interface shear from load cells"),
    "floor_accelerations": ("measured", "absolute accelerations of the floors of the specimen, from the table up"),
    "interface_force": ("computed", "estimated interface shear"),
    "corrected_force": ("computed", "interface shear fed back"),
}


def exported_run(analysis: RunAnalysis, name: str) -> ExportedRun:
    """Return everything that is exported of a run.

    Parameters
    ----------
    analysis : RunAnalysis
        The run and its errors.
    name : str
        What tells it from other runs.
    """
    record, left_out = analysis.record, []
    channels = [*_times(0, record.steps, record.time_step), *_recorded(record), *_readings(analysis)]
    for what, compute in (
        ("floor displacements, drifts and story forces", _numerical),
        ("story shears of the specimen", _specimen),
        ("reference", _reference),
    ):
        found = compute(analysis)
        if isinstance(found, str):
            left_out.append(f"{what}: {found}")
        else:
            channels += found
    return ExportedRun(name, analysis, tuple(channels), tuple(_rest(record)), tuple(left_out))


def ascii_unit(unit: str) -> str:
    """Return a unit without characters that not every program reads."""
    return unit.replace("²", "2")


def _times(first: int, steps: int, time_step: float) -> list[Channel]:
    index = np.arange(first, first + steps, dtype=np.int64)
    return [
        Channel("step", "1", "time", "step index", index),
        Channel("time", "s", "time", "test time of what the controller computes and commands", time_step * index),
        Channel(
            "sensor_time", "s", "time", "test time of what is measured: the end of the step", time_step * (index + 1)
        ),
    ]


def _recorded(record: RunRecord) -> list[Channel]:
    return [
        Channel(signal.name, ascii_unit(signal.unit), *_told(signal.name, signal.instant), getattr(record, signal.name))
        for signal in SIGNALS
    ]


def _readings(analysis: RunAnalysis) -> list[Channel]:
    """Return what the sensors of a calibrated rig read, from the values that stand for it."""
    config = analysis.config
    calibration = Calibration(config.sensors, len(config.specimen.masses))
    if calibration.is_identity:
        return []
    return [
        Channel(
            f"{name}_reading",
            "unit of the reading",
            "measured",
            f"reading behind {name}, at sensor_time: value / scale + offset of the section sensors",
            calibration.readings(name, getattr(analysis.record, name)),
        )
        for name in (*CHANNELS, "floor_accelerations")
    ]


def _told(name: str, instant: Instant) -> tuple[str, str]:
    kind, description = _MEANING[name]
    return kind, f"{description}, at {'time' if instant is Instant.BEGIN else 'sensor_time'}"


def _numerical(analysis: RunAnalysis) -> list[Channel] | str:
    run = ReportedRun(analysis, "")
    if run.no_forces:
        return run.no_forces
    motion = run.motion
    floors, stories = "floors of the numerical substructure", "stories of the numerical substructure"
    return [
        Channel(
            "floor_displacements", "m", "computed", f"{floors}, relative to the ground, at time", motion.displacements
        ),
        Channel("floor_velocities", "m/s", "computed", f"{floors}, relative to the ground, at time", motion.velocities),
        Channel("computed_accelerations", "m/s2", "computed", f"{floors}, absolute, at time", motion.accelerations),
        Channel("story_drifts", "m", "computed", f"{stories}, at time", motion.drifts),
        Channel("story_forces", "N", "computed", f"restoring forces of the {stories}, at time", motion.story_forces),
    ]


def _specimen(analysis: RunAnalysis) -> list[Channel] | str:
    run = ReportedRun(analysis, "")
    if run.no_floors:
        return run.no_floors
    shears = specimen_story_shears(analysis.record, analysis.config)
    description = "stories of the specimen, from measured accelerations and nominal masses, at sensor_time"
    return [Channel("specimen_story_shears", "N", "computed", description, shears)]


def _reference(analysis: RunAnalysis) -> list[Channel] | str:
    whole = "of the building without partition, numerical stories first, at time"
    try:
        motion = reference_motion_of(analysis.record, analysis.config)
    except InputError as error:
        return str(error)
    relative = f"relative to the ground, floors {whole}"
    return [
        Channel("reference_accelerations", "m/s2", "reference", f"absolute, floors {whole}", analysis.reference),
        Channel("reference_displacements", "m", "reference", relative, motion.displacements),
        Channel("reference_drifts", "m", "reference", f"stories {whole}", motion.drifts),
    ]


def _rest(record: RunRecord) -> list[Channel]:
    rest = record.way_to_rest
    first, steps = (record.steps, 0) if rest is None else (rest.first_step, rest.steps)
    units = {signal.name: (ascii_unit(signal.unit), signal.instant) for signal in SIGNALS}
    channels = _times(first, steps, record.time_step)
    for name, values in _rest_signals(record).items():
        unit, instant = units[name]
        channels.append(Channel(name, unit, *_told(name, instant), values))
    return channels


def _rest_signals(record: RunRecord) -> dict[str, FloatArray]:
    if record.way_to_rest is not None:
        return record.way_to_rest.signals()
    return {name: getattr(record, name)[:0] for name in REST_SIGNALS}


def numbers_of(channels: Sequence[Channel]) -> dict[str, Numbers]:
    """Return channels as columns of one number each, by name.

    Parameters
    ----------
    channels : sequence of Channel
        Of one table.
    """
    return {name: column for channel in channels for name, column in channel.columns()}
