"""Compensators that make the actuator of the benchmark problem follow: what they are told, and a constant lead."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.vrths.actuator import ActuatorMeasurement

FloatArray = NDArray[np.float64]


class Asked(NamedTuple):
    """What a tracker is told at the begin of a step, in p lanes.

    Parameters
    ----------
    motion : ndarray, shape (2n, p)
        Displacements, then velocities of the numerical substructure relative to the ground; the first is the desired
        displacement [m, m/s].
    ground_acceleration : float
        Of this step [m/s²].
    measurement : ActuatorMeasurement
        Sensors at this moment, the end of the step before.
    """

    motion: FloatArray
    ground_acceleration: float
    measurement: ActuatorMeasurement


class Tracker(Protocol):
    """Turn the desired displacement into the command of the actuator, in p lanes. Reads no clock, logs nothing."""

    def reset(self) -> None:
        """Return to rest before step 0."""

    def step(self, asked: Asked) -> FloatArray:
        """Return the commanded displacement of every lane [m], shape (p,).

        Parameters
        ----------
        asked : Asked
            What is known at the begin of the step.
        """


class VelocityLead:
    """u = d + τ ḋ: the constant delay τ of the actuator, taken out by the velocity of the numerical substructure.

    Parameters
    ----------
    lead_time : float
        τ [s].
    """

    def __init__(self, lead_time: float) -> None:
        self._lead_time = lead_time

    def reset(self) -> None:
        """Do without."""

    def step(self, asked: Asked) -> FloatArray:
        """Return the command of this step."""
        motion = asked.motion
        return np.asarray(motion[0] + self._lead_time * motion[len(motion) // 2])
