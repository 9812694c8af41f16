"""Drive a table with an excitation and record what its sensors say."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.centring import Centring
from bmd_rths_core.identification.frequency_response import FloatArray
from bmd_rths_core.loop.conductor import Begun, Conductor
from bmd_rths_core.loop.hosting import Clock, VirtualClock, ending, run_to_rest
from bmd_rths_core.loop.states import Outcome
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.record import RunRecord
from bmd_rths_core.safety import SafetySupervisor
from bmd_rths_core.table.calibration import Calibration
from bmd_rths_core.table.controller import TableController, TableMeasurement

#: How often `drive` reports progress [steps].
PROGRESS_PERIOD = 200


@dataclass(frozen=True)
class Responses:
    """What a table and a specimen did, without gaps; row k belongs to command k and was read at its end.

    Parameters
    ----------
    time_step : float
        Δt [s].
    command : ndarray, shape (N,)
        Acceleration command that was applied [m/s²].
    table : ndarray, shape (N,)
        Measured absolute acceleration of the table [m/s²].
    floors : ndarray, shape (N, n)
        Measured absolute accelerations of the floors, from the table up [m/s²].
    source : str
        Text that says where the responses come from.
    displacement, shear : ndarray, shape (N,), optional
        Measured displacement of the table [m] and interface shear from load cells [N]; NaN without a sensor.
    """

    time_step: float
    command: FloatArray
    table: FloatArray
    floors: FloatArray
    source: str
    displacement: FloatArray | None = None
    shear: FloatArray | None = None

    @property
    def largest_table(self) -> float:
        """Largest absolute acceleration of the table [m/s²]."""
        return float(np.max(np.abs(self.table)))

    @property
    def largest_floor(self) -> float:
        """Largest absolute acceleration of any floor [m/s²]."""
        return float(np.max(np.abs(self.floors)))


class DrivingStopped(Exception):
    """A limit, the controller or an operator ended the drive; the text says which."""


class _Excitation:
    """The excitation in the place of the numerical substructure: it wants what it was given, and feels nothing."""

    displacements = np.zeros(0)
    takes_feedback = True

    def reset(self) -> None:
        """Nothing to forget."""

    def step(self, ground_acceleration: float, feedback_force: float) -> Begun:
        """Ask for the command of this step."""
        return Begun(0, ground_acceleration, ground_acceleration, feedback_force, ground_acceleration)

    def learn(self, measurement: TableMeasurement) -> None:
        """Do without."""


def drive(
    table: TableController,
    supervisor: SafetySupervisor,
    commands: FloatArray,
    time_step: float,
    progress: Callable[[int], None] | None = None,
    clock: Clock | None = None,
    stops_asked: Callable[[], int] = lambda: 0,
    calibration: Calibration | None = None,
) -> Responses:
    """Drive a table with given commands; it is brought to rest, stopped and closed whatever happens.

    Parameters
    ----------
    table : TableController
        The table.
    supervisor : SafetySupervisor
        Limits, and the way to rest at the end.
    commands : ndarray, shape (N,)
        Acceleration commands [m/s²].
    time_step : float
        Δt the table runs with [s].
    progress : callable, optional
        Called with the number of finished steps every `PROGRESS_PERIOD` steps and at the end.
    clock : Clock, optional
        Commands go out by this clock, one every Δt, and what late ones leave behind is taken away (`Centring`); by
        default each goes out as soon as the one before is answered.
    stops_asked : callable
        As `run_to_rest` takes it.
    calibration : Calibration, optional
        Of the sensors.

    Returns
    -------
    Responses
        The longest stretch of steps that were answered.

    Raises
    ------
    DrivingStopped
        The drive did not come to its end; the table is at rest, or was stopped by its controller.
    InputError
        A sensor that is needed gave no value.
    """
    signals, drives = np.full((len(commands), 0), np.nan), np.full((len(commands), 2), np.nan)
    answered = 0

    def on_step(begun: Begun) -> None:
        command = begun.desired_acceleration
        if centring is not None:
            command = centring.corrected(begun.step, command, supervisor.motion)
        driver.command(begun.step, command, time.now())
        conductor.passed_on(driver.sent_at)

    def on_measurement(measured: TableMeasurement) -> None:
        nonlocal signals, answered
        row = (measured.applied_command, measured.table_acceleration, *measured.floor_accelerations)
        if not signals.shape[1]:
            signals = np.full((len(commands), len(row)), np.nan)
        signals[measured.step] = row
        drives[measured.step] = measured.table_displacement, measured.base_shear
        if not np.isfinite(row).all():
            missing.append(measured.step)
        answered += 1
        conductor.shear(measured.step, 0.0, time.now())
        if progress is not None and answered % PROGRESS_PERIOD == 0:
            progress(measured.step + 1)

    missing: list[int] = []
    centring = None if clock is None else Centring(commands, time_step)
    time = clock or VirtualClock()
    driver = TableDriver(table, supervisor, time_step, clock is None, on_measurement, calibration=calibration)
    # Lost answers are judged by the limits of the supervisor alone.
    conductor = Conductor(commands.tolist(), _Excitation(), None, time_step, clock is None, math.inf, on_step)
    try:
        run_to_rest(conductor, driver, time, stops_asked)
    except (OSError, RuntimeError) as error:
        raise DrivingStopped(f"table controller: {error}") from error
    outcome, reason = ending(conductor, driver)
    if outcome is not Outcome.FINISHED:
        raise DrivingStopped(reason)
    if progress is not None:
        progress(conductor.step)
    if missing:
        raise InputError(f"identification: step {missing[0]} has no acceleration of table or floors; all are required")
    first, end = _longest_stretch(signals)
    lost = len(commands) - answered
    source = f"driven; {lost} of {len(commands)} steps were not answered in time, used are {first} to {end - 1}"
    own = signals[first:end]
    return Responses(time_step, own[:, 0], own[:, 1], own[:, 2:], source if lost else "driven", *drives[first:end].T)


def responses_of(record: RunRecord) -> Responses:
    """Return the longest stretch of a record that has no gap.

    Parameters
    ----------
    record : RunRecord
        A run, for example from a bag.

    Returns
    -------
    Responses
        Its source says which steps were taken.

    Raises
    ------
    InputError
        No step has all signals.
    """
    signals = np.column_stack((record.applied_command, record.table_acceleration, record.floor_accelerations))
    first, end = _longest_stretch(signals)
    if first == end:
        raise InputError(f"{record.source}: no step has applied command and accelerations of table and floors")
    source = f"steps {first} to {end - 1} of {record.steps} of {record.source}"
    own, drives = signals[first:end], (record.table_displacement[first:end], record.base_shear[first:end])
    return Responses(record.time_step, own[:, 0], own[:, 1], own[:, 2:], source, *drives)


def _longest_stretch(signals: FloatArray) -> tuple[int, int]:
    """Return first and last step, the latter exclusive, of the longest stretch in which every value is there."""
    whole = np.isfinite(signals).all(axis=1) & (signals.shape[1] > 0)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], whole, [False]))))
    stretches = edges.reshape(-1, 2)
    if not len(stretches):
        return 0, 0
    first, end = stretches[np.argmax(stretches[:, 1] - stretches[:, 0])].tolist()
    return first, end
