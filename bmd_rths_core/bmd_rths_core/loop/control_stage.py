"""An interface control in the place of the numerical substructure, as the conductor drives it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.protocol import InterfaceControl, InterfaceDemand
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]


class ControlStage:
    """Give an interface control the ground motion it has to know in advance.

    Parameters
    ----------
    control : InterfaceControl
        The control.
    ground : ndarray, shape (N,)
        Ground acceleration of the whole test [m/s²].
    """

    takes_feedback = False

    def __init__(self, control: InterfaceControl, ground: FloatArray) -> None:
        self._control, self._length = control, control.preview + 1
        self._ground = np.append(ground, np.zeros(control.preview))
        self._step = 0

    @property
    def displacements(self) -> FloatArray:
        """Of the numerical floors, shape (n,) [m]."""
        return self._control.displacements

    def reset(self) -> None:
        """Return to rest before step 0."""
        self._control.reset()
        self._step = 0

    def step(self, ground_acceleration: float, feedback_force: float) -> InterfaceDemand:
        """Return what is asked for in this step; the control knows better than the shear that is fed back."""
        begin = self._step
        self._step = begin + 1
        return self._control.step(self._ground[begin : begin + self._length])

    def learn(self, measurement: TableMeasurement) -> None:
        """Pass the sensors on, unless they come too late for the step that follows them."""
        if measurement.step == self._step - 1:
            self._control.learn(measurement)
