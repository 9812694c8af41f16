"""Replay of a recorded run: its measurements once more through shear estimator and force correction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_force_correction, make_shear_estimator
from bmd_rths_core.record import FloatArray, RunRecord, software_versions
from bmd_rths_core.signals import SIGNALS
from bmd_rths_core.table.controller import TableMeasurement

BoolArray = NDArray[np.bool_]

#: What is computed anew.
REPLAYED_SIGNALS = ("interface_force", "corrected_force")

#: Sections both stages are made from; of the others only the scheme has an effect.
_SECTIONS = ("specimen", "shear_estimator", "force_correction")
_EFFECTIVE_PARAMETER = "run.scheme"

_MEASURED_SIGNALS = tuple(s.name for s in SIGNALS if s.measured and not s.per_floor)


@dataclass(frozen=True)
class SignalDifference:
    """How far a replayed signal is from the recorded one, over the steps that can be compared.

    Parameters
    ----------
    compared : int
        Steps that are recorded, and of which the recording holds all that led to them.
    differing : int
        Those of them that are not equal bit for bit, or that the replay has no value of.
    first_step : int or None
        The first one that differs.
    missing : int
        Compared steps that the replay has no value of; they are left out of what follows.
    rmse : float
        Root mean square of the difference [N].
    rmse_percent : float
        The same relative to the recorded signal, as Eq. 12 has it [%]; NaN where that is zero.
    largest : float
        Largest absolute difference [N].
    largest_step : int or None
        Where it is; None without a difference.
    """

    compared: int
    differing: int
    first_step: int | None
    missing: int
    rmse: float
    rmse_percent: float
    largest: float
    largest_step: int | None


@dataclass(frozen=True)
class Replay:
    """A recorded run and its replay.

    Parameters
    ----------
    recorded : RunRecord
        The run, N steps.
    replayed : RunRecord
        The same with the forces of the replay; a step that was not computed in the run is NaN.
    known : Mapping of str to ndarray, each of shape (N,)
        For each of `REPLAYED_SIGNALS`, whether the recording holds all that led to the value of a step.
    """

    recorded: RunRecord
    replayed: RunRecord
    known: Mapping[str, BoolArray]

    def differences(self) -> dict[str, SignalDifference]:
        """Return the difference of each of `REPLAYED_SIGNALS`."""
        return {
            name: _difference(getattr(self.recorded, name), getattr(self.replayed, name), known)
            for name, known in self.known.items()
        }

    def unknown_steps(self, name: str) -> list[tuple[int, int]]:
        """Return the recorded steps that cannot be compared.

        Parameters
        ----------
        name : str
            One of `REPLAYED_SIGNALS`.

        Returns
        -------
        list of tuple of int
            First and last step of every stretch.
        """
        unknown = ~self.known[name] & _recorded(getattr(self.recorded, name))
        edges = np.flatnonzero(np.diff(np.concatenate(([0], unknown.astype(np.int8), [0]))))
        return [(int(begin), int(end) - 1) for begin, end in edges.reshape(-1, 2)]


def replay(record: RunRecord, config: Config) -> Replay:
    """Compute interface force and corrected force again from the recorded measurements and required forces.

    Parameters
    ----------
    record : RunRecord
        A run, in process or from a bag.
    config : Config
        Configuration of the replay: that of the run, or a changed one.

    Returns
    -------
    Replay
        Equal to the recording bit for bit with the same parameters and libraries.

    Raises
    ------
    InputError
        Time step or number of floors are not those of the record.

    Notes
    -----
    In real time a stage skips a step whose message does not reach it. The replay skips the same steps: the estimator
    had a step if its output is recorded or the corrected force that was made from it, the force correction if its own
    is. The Kalman filter remembers, so that its outputs are not known after a measurement that it had but that is not
    recorded, or after a step at which the recorder lost even the desired acceleration, which is sent at every step.
    """
    _check(record, config)
    estimator, correction = make_shear_estimator(config), make_force_correction(config)
    estimator.reset()
    correction.reset()
    interface, corrected = np.full((2, record.steps), np.nan)
    for step in np.flatnonzero(_estimated(record) & measured_steps(record)).tolist():
        interface[step] = estimator.step(measurement_at(record, step))
    required = record.required_force.tolist()
    for step in np.flatnonzero(_recorded(record.corrected_force)).tolist():
        corrected[step] = correction.step(required[step], float(interface[step]))
    lost = _estimated(record) & ~measured_steps(record)
    remembered = lost | (~_estimated(record) & ~_recorded(record.desired_acceleration))
    return _beside(record, config, {"interface_force": interface, "corrected_force": corrected}, lost, remembered)


def answered_replay(record: RunRecord, answers: Mapping[str, Mapping[int, float]]) -> Replay:
    """Return the replay whose forces other nodes have computed, each of which got every recorded message.

    Parameters
    ----------
    record : RunRecord
        The run.
    answers : Mapping of str to Mapping of int to float
        For each of `REPLAYED_SIGNALS`, values by step [N].

    Returns
    -------
    Replay
        Outputs of a Kalman filter are not known either after a measurement that it did not get in the run.
    """
    forces = {name: np.full(record.steps, np.nan) for name in REPLAYED_SIGNALS}
    for name, force in forces.items():
        force[list(answers[name])] = list(answers[name].values())
    config = config_from_mapping(record.configuration)
    lost = _estimated(record) & ~measured_steps(record)
    return _beside(record, config, forces, lost, _estimated(record) != measured_steps(record))


def changed_parameters(before: Config, after: Config) -> tuple[dict[str, tuple[Any, Any]], list[str]]:
    """Return what a replay does otherwise than the run.

    Parameters
    ----------
    before, after : Config
        Configuration of the run and of the replay.

    Returns
    -------
    effective : dict of str to tuple
        Old and new value of every changed parameter that a replay depends on, by ``section.key``.
    idle : list of str
        Changed parameters that have no effect in a replay.
    """
    old, new = before.as_mapping(), after.as_mapping()
    changed = {
        f"{section}.{key}": (old[section][key], value)
        for section, values in new.items()
        for key, value in values.items()
        if value != old[section][key]
    }
    effective = {
        name: values
        for name, values in changed.items()
        if name == _EFFECTIVE_PARAMETER or name.partition(".")[0] in _SECTIONS
    }
    return effective, [name for name in changed if name not in effective]


def measured_steps(record: RunRecord) -> BoolArray:
    """Return for each step whether a measurement is recorded, shape (N,).

    Parameters
    ----------
    record : RunRecord
        The run. A laboratory may lack sensors: one value that is there is enough.
    """
    signals = [getattr(record, name) for name in _MEASURED_SIGNALS]
    measured: BoolArray = np.any([_recorded(s) for s in (*signals, *record.floor_accelerations.T)], axis=0)
    return measured


def measurement_at(record: RunRecord, step: int) -> TableMeasurement:
    """Return the recorded measurement of a step.

    Parameters
    ----------
    record : RunRecord
        The run.
    step : int
        Step index.
    """
    return TableMeasurement(
        step,
        float(record.applied_command[step]),
        float(record.table_displacement[step]),
        float(record.table_acceleration[step]),
        float(record.actuator_force[step]),
        float(record.base_shear[step]),
        record.floor_accelerations[step],
    )


def _beside(
    record: RunRecord, config: Config, forces: Mapping[str, FloatArray], lost: BoolArray, remembered: BoolArray
) -> Replay:
    """Put forces beside those of the record.

    At the steps `lost` the input of the estimator is not recorded; at the steps `remembered` it is not certain whether
    a filter with a memory had the same input as in the replay.
    """
    if config.shear_estimator.source == "kalman":
        lost = np.logical_or.accumulate(remembered)
    replayed = replace(
        record,
        **forces,  # type: ignore[arg-type]
        configuration=config.as_mapping(),
        versions={**record.versions, **software_versions()},
        reason="; ".join(filter(None, (record.reason, "interface and corrected force are those of a replay"))),
    )
    known = {"interface_force": ~lost, "corrected_force": ~lost & _recorded(record.required_force)}
    return Replay(record, replayed, known)


def _check(record: RunRecord, config: Config) -> None:
    if config.run.time_step != record.time_step:
        raise InputError(f"run.time_step: {config.run.time_step:g} s; that of the recording, {record.time_step:g} s")
    floors, recorded = len(config.specimen.masses), record.floor_accelerations.shape[1]
    if recorded == 0:
        raise InputError(f"{record.source}: no measurement is recorded; there is nothing to replay")
    if floors != recorded:
        raise InputError(f"specimen.masses: {floors} entries; {recorded} are required, one for each recorded floor")


def _estimated(record: RunRecord) -> BoolArray:
    """Return the steps that the estimator had."""
    return _recorded(record.interface_force) | _recorded(record.corrected_force)


def _recorded(signal: FloatArray) -> BoolArray:
    return ~np.isnan(signal)


def _difference(recorded: FloatArray, replayed: FloatArray, known: BoolArray) -> SignalDifference:
    compared = _recorded(recorded) & known
    equal_bits = recorded.view(np.int64) == np.ascontiguousarray(replayed).view(np.int64)
    differing = np.flatnonzero(compared & ~equal_bits)
    both = np.flatnonzero(compared & _recorded(replayed))
    distance = np.abs(replayed[both] - recorded[both])
    largest = int(np.argmax(distance)) if len(both) else -1
    differs = largest >= 0 and distance[largest] != 0.0
    return SignalDifference(
        compared=int(compared.sum()),
        differing=len(differing),
        first_step=int(differing[0]) if len(differing) else None,
        missing=int(compared.sum()) - len(both),
        rmse=float(np.sqrt(np.mean(distance**2))) if len(both) else float("nan"),
        rmse_percent=rmse_percent(recorded[both], replayed[both]),
        largest=float(distance[largest]) if len(both) else float("nan"),
        largest_step=int(both[largest]) if differs else None,
    )
