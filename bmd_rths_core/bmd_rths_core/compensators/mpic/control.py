"""Model-predictive interface control: one step after the other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.mpic.packed import PackedStep
from bmd_rths_core.compensators.protocol import InterfaceDemand, LinearControl
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]


class MpicControl:
    """Drive the table along the interface of the virtual building, which the measurements correct.

    Parameters
    ----------
    packed : PackedStep
        Observer, virtual building and tracking.
    floors : int
        Number of floors n of the specimen.
    load_cell : bool
        The base shear is one of the sensors.

    Attributes
    ----------
    preview, displacements
        See `InterfaceControl`.
    packed : PackedStep
        Of the next step; another one has to have the same layout.
    """

    def __init__(self, packed: PackedStep, floors: int, load_cell: bool) -> None:
        layout = packed.layout
        self.packed, self._layout, self._floors, self._load_cell = packed, layout, floors, load_cell
        self.preview = layout.ground_acceleration.stop - layout.ground_acceleration.start - 1
        self._stacked = np.zeros(layout.states + layout.inputs)
        self._result = np.zeros(packed.outputs + layout.states)
        self._state, self._next = self._stacked[: layout.states], self._result[packed.outputs :]
        self._ground = self._stacked[layout.ground_acceleration]
        self._measured = self._stacked[layout.measured]
        self._command_error = layout.command_error.start
        self.displacements = self._result[3 : packed.outputs]
        self.reset()

    def reset(self) -> None:
        """Return to rest before step 0."""
        self._stacked[:] = 0.0
        self._result[:] = 0.0
        self._observed = False
        self._steps = 0

    def step(self, ground_acceleration: FloatArray) -> InterfaceDemand:
        """Return what is asked for in this step; the force that acts is the estimate of the virtual building."""
        if self._steps:
            self._state[:] = self._next
        else:
            np.multiply(self.packed.start, ground_acceleration[0], out=self._state)
        self._steps += 1
        self._ground[:] = ground_acceleration
        np.dot(self.packed.measured if self._observed else self.packed.bridged, self._stacked, out=self._result)
        self._observed = False
        self._stacked[self._command_error] = 0.0
        desired, force, command = self._result[:3].tolist()
        return InterfaceDemand(desired, force, command)

    def expects(self, measurement: TableMeasurement) -> bool:
        """Tell whether a measurement is that of the last step.

        Parameters
        ----------
        measurement : TableMeasurement
            Any.
        """
        return measurement.step == self._steps - 1

    def learn(self, measurement: TableMeasurement) -> None:
        """Take in the sensors of the last step; with a missing value only the command that was applied counts."""
        if not self.expects(measurement):
            return
        measured, floors = self._measured, self._floors
        measured[0] = measurement.table_acceleration
        measured[1 : floors + 1] = measurement.floor_accelerations
        measured[floors + 1] = measurement.table_displacement
        if self._load_cell:
            measured[floors + 2] = measurement.base_shear
        self._observed = bool(np.isfinite(measured).all())
        if not self._observed:
            measured[:] = 0.0
        if math.isfinite(measurement.applied_command):
            self._stacked[self._command_error] = measurement.applied_command - self._result[2]

    def state_space(self) -> LinearControl:
        """Return the control as a linear system, every step measured and every command applied as asked for."""
        layout, outputs, floors = self._layout, self.packed.outputs, self._floors
        own, matrix = layout.states, self.packed.measured
        measured = matrix[:, layout.measured]
        by_sensors = np.zeros((len(matrix), floors + 4))
        by_sensors[:, : floors + 1] = measured[:, : floors + 1]
        by_sensors[:, floors + 2] = measured[:, floors + 1]
        if self._load_cell:
            by_sensors[:, floors + 1] = measured[:, floors + 2]
        by_inputs = np.hstack((matrix[:, layout.ground_acceleration], by_sensors))
        system = DiscreteStateSpace(
            matrix[outputs:, :own], by_inputs[outputs:], matrix[:outputs, :own], by_inputs[:outputs]
        )
        return LinearControl(system, self.packed.start, (layout.ground.start, layout.ground.stop - 1))
