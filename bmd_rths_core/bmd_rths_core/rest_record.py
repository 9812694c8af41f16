"""The way to rest as it was recorded: what was commanded after the test, and how the table moved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RestRecord:
    """Commands and measurements from the last step of a test until the table is at rest.

    Row j belongs to step ``first_step + j``: steps are counted on from those of the test, and each signal has unit,
    sign and instant of its namesake in `RunRecord`. In real time a command may be held for longer than Δt; steps that
    pass meanwhile are rows without a command. What was not measured is NaN.

    Parameters
    ----------
    first_step : int
        Step of row 0. Where a limit refused the last command of the test, the way begins in the slot of that command.
    command : ndarray, shape (M,)
        Acceleration command of the safety supervisor [m/s²].
    applied_command : ndarray, shape (M,)
        Acceleration command the table controller says it applied [m/s²].
    table_acceleration : ndarray, shape (M,)
        Measured absolute acceleration of the table [m/s²].
    table_displacement : ndarray, shape (M,)
        Measured displacement of the table [m].
    actuator_force : ndarray, shape (M,)
        Measured force of the actuator [N].
    base_shear : ndarray, shape (M,)
        Interface shear from load cells [N].
    floor_accelerations : ndarray, shape (M, n)
        Measured absolute acceleration of the floors of the experimental substructure [m/s²].
    """

    first_step: int
    command: FloatArray
    applied_command: FloatArray
    table_acceleration: FloatArray
    table_displacement: FloatArray
    actuator_force: FloatArray
    base_shear: FloatArray
    floor_accelerations: FloatArray

    @property
    def steps(self) -> int:
        """Number of rows M."""
        return len(self.command)

    def signals(self) -> dict[str, FloatArray]:
        """Return every signal by name."""
        return {name: getattr(self, name) for name in REST_SIGNALS}

    def same_signals(self, other: RestRecord | None) -> bool:
        """Tell whether another way to rest has the same steps and signals, bit for bit (a NaN equals a NaN).

        Parameters
        ----------
        other : RestRecord or None
            The other one.
        """
        if other is None or other.first_step != self.first_step:
            return False
        mine, theirs = self.signals(), other.signals()
        return all(np.array_equal(mine[name], theirs[name], equal_nan=True) for name in mine)


#: Its signals, each named as in `RunRecord`.
REST_SIGNALS = tuple(field.name for field in fields(RestRecord) if field.name != "first_step")


def rest_record(
    commands: Mapping[int, float], measurements: Mapping[int, TableMeasurement], floors: int
) -> RestRecord | None:
    """Put in order what was heard on the way to rest.

    Parameters
    ----------
    commands : Mapping of int to float
        Acceleration commands by step [m/s²].
    measurements : Mapping of int to TableMeasurement
        Measurements by step.
    floors : int
        Number of measured floors n.

    Returns
    -------
    RestRecord or None
        None when there was nothing: the table was at rest, its controller stopped it, or nobody recorded it.
    """
    heard = commands.keys() | measurements.keys()
    if not heard:
        return None
    first, steps = min(heard), max(heard) - min(heard) + 1
    shapes = dict.fromkeys(REST_SIGNALS, (steps,)) | {"floor_accelerations": (steps, floors)}
    signals = {name: np.full(shape, np.nan) for name, shape in shapes.items()}
    for step, command in commands.items():
        signals["command"][step - first] = command
    for step, measurement in measurements.items():
        for name in TableMeasurement._fields[1:]:
            signals[name][step - first] = getattr(measurement, name)
    return RestRecord(first, **signals)
