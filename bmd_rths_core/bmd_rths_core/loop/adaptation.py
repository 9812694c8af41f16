"""What a compensator adapted in the course of a test, from the record of the test alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_command_shaper, make_interface_control
from bmd_rths_core.loop.control_stage import ControlStage
from bmd_rths_core.record import RunRecord
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]


def adapted_over_time(config: Config, record: RunRecord) -> dict[str, FloatArray]:
    """Return what the compensator of a configuration adapted, step by step.

    Parameters
    ----------
    config : Config
        Of the test.
    record : RunRecord
        What was recorded, in process or from a bag. A compensator depends on nothing else, so that it does again what
        it did in the test.

    Returns
    -------
    dict of str to ndarray, shape (N,)
        By name, each value as it was used in the step; empty for a compensator that does not adapt.

    Raises
    ------
    InputError
        The compensator refuses what is known.
    """
    control = make_interface_control(config)
    part: Any = make_command_shaper(config) if control is None else control
    if not hasattr(part, "adapted"):
        return {}
    stage = None if control is None else ControlStage(control, record.ground_acceleration)
    steps = len(record.command)
    values = {name: np.empty(steps) for name in part.adapted}
    part.reset()
    for k in range(steps):
        for name, value in part.adapted.items():
            values[name][k] = value
        if stage is None:
            part.step(float(record.desired_acceleration[k]))
        else:
            stage.step(float(record.ground_acceleration[k]), 0.0)
        measured = _measurement(record, k)
        if measured is not None:
            part.learn(measured)
    return values


def _measurement(record: RunRecord, k: int) -> TableMeasurement | None:
    """Return what the sensors said in a step, or None where nothing was recorded."""
    floors = record.floor_accelerations[k]
    measured = TableMeasurement(
        k,
        float(record.applied_command[k]),
        float(record.table_displacement[k]),
        float(record.table_acceleration[k]),
        float(record.actuator_force[k]),
        float(record.base_shear[k]),
        floors,
    )
    return measured if np.isfinite([*measured[1:6], *floors]).any() else None
