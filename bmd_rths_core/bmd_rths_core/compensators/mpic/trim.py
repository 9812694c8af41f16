"""Trim of MPIC: gain and delay of the table that its identified model does not have, found while the test runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.identified_table import HeldTable
from bmd_rths_core.compensators.inverse import cascade
from bmd_rths_core.compensators.mpic.adaptation import StiffnessControl
from bmd_rths_core.compensators.mpic.continuity import Continuity
from bmd_rths_core.compensators.mpic.control import MpicControl
from bmd_rths_core.compensators.protocol import InterfaceDemand, LinearControl
from bmd_rths_core.errors import InputError
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]

#: Band in which table and model are compared [Hz].
BAND = (1.0, 8.0)


class TrimLimits(NamedTuple):
    """How slowly the trim looks and moves, and how far it goes.

    Parameters
    ----------
    memory : float
        Time in which the past is forgotten [s].
    quiet : float
        Motion of the model in the band, root mean square, below which nothing moves [m/s²].
    gain : float
        Largest gain; the least is its inverse.
    delay : float
        Largest absolute delay [s].
    gain_rate : float
        [1/s].
    delay_rate : float
        [s/s].
    """

    memory: float
    quiet: float
    gain: float
    delay: float
    gain_rate: float
    delay_rate: float


class TrimmedControl:
    """Give the table (u + τ u̇) / g for the command u of MPIC, with the gain g and delay τ that it turns out to have.

    Parameters
    ----------
    control : MpicControl or StiffnessControl
        It goes on with u: to it the trimmed table is the one that was identified.
    table : HeldTable
        The identified table.
    limits : TrimLimits
        Of the trim.
    time_step : float
        Δt [s].

    Attributes
    ----------
    preview, displacements
        See `InterfaceControl`.

    Notes
    -----
    With a_o the acceleration of the model under the command that was applied, the table does y ≈ g a_o − g τ ȧ_o. Both
    sides through one band-pass; g and g τ by recursive least squares with exponential forgetting (Ljung 1999, "System
    Identification", section 11.2).
    """

    def __init__(
        self, control: MpicControl | StiffnessControl, table: HeldTable, limits: TrimLimits, time_step: float
    ) -> None:
        # scipy.signal takes half a second to import, which the other schemes need not wait.
        from scipy.signal import butter

        if not BAND[1] < 0.5 / time_step:
            raise InputError(f"run.time_step: {time_step:g} s; mpic.trim requires less than {0.5 / BAND[1]:g} s")
        self._control, self._table, self._limits, self._time_step = control, table, limits, time_step
        self._band = cascade(np.asarray(butter(2, BAND, "bandpass", fs=1.0 / time_step, output="sos")))
        self._keeps = math.exp(-time_step / limits.memory)
        self._continuity = Continuity(time_step)
        self.preview, self.displacements = control.preview, control.displacements
        self.reset()

    @property
    def adapted(self) -> Mapping[str, float]:
        """Gain [1] and delay [s] of this step, by name, and what the control adapts by itself."""
        own = {"table_gain": self._gain, "table_delay": self._delay}
        return own if isinstance(self._control, MpicControl) else {**own, **self._control.adapted}

    def reset(self) -> None:
        """Return to rest before step 0, with the identified table."""
        self._control.reset()
        self._gain, self._delay = 1.0, 0.0
        self._asked = self._given = 0.0
        self._modelled = np.zeros((len(self._table.transition), 1))
        self._last = 0.0
        self._filters = np.zeros((len(self._band.a), 3))
        self._normal = np.zeros((3, 3))
        self._step = -1
        self._continuity.reset()

    def step(self, ground_acceleration: FloatArray) -> InterfaceDemand:
        """Return what MPIC asks for, its command trimmed."""
        self._step += 1
        demand = self._control.step(ground_acceleration)
        rate = (demand.command - self._asked) / self._time_step
        self._asked = demand.command
        self._given = (demand.command + self._delay * rate) / self._gain
        return demand._replace(command=self._given)

    def learn(self, measurement: TableMeasurement) -> None:
        """Tell MPIC what its table did, and move the trim by at most what a step allows."""
        applied, measured = measurement.applied_command, measurement.table_acceleration
        difference = applied - self._given if math.isfinite(applied) else 0.0
        self._control.learn(measurement._replace(applied_command=self._asked + self._gain * difference))
        if measurement.step != self._step:
            return
        unbroken = self._continuity.unbroken(self._step, math.isfinite(measured))
        self._modelled = self._table.transition @ self._modelled + self._table.command * (self._given + difference)
        model = (self._table.acceleration @ self._modelled).item()
        signals = np.array([model, (self._last - model) / self._time_step, measured])
        if not math.isfinite(measured):
            signals[2] = model
        self._last = model
        filtered = (self._band.c @ self._filters + self._band.d * signals)[0]
        self._filters = self._band.a @ self._filters + self._band.b * signals
        if not unbroken:
            return
        self._normal = self._keeps * self._normal + np.outer(filtered, filtered)
        self._move()

    def _move(self) -> None:
        normal, limits, step = self._normal, self._limits, self._time_step
        if (1.0 - self._keeps) * normal[0, 0] <= limits.quiet**2:
            return
        determinant = normal[0, 0] * normal[1, 1] - normal[0, 1] ** 2
        if determinant <= 1e-9 * normal[0, 0] * normal[1, 1]:  # one frequency only
            return
        gain = (normal[1, 1] * normal[0, 2] - normal[0, 1] * normal[1, 2]) / determinant
        shifted = (normal[0, 0] * normal[1, 2] - normal[0, 1] * normal[0, 2]) / determinant
        gain = min(max(float(gain), 1.0 / limits.gain), limits.gain)
        delay = min(max(float(shifted) / gain, -limits.delay), limits.delay)
        self._gain += min(max(gain - self._gain, -limits.gain_rate * step), limits.gain_rate * step)
        self._delay += min(max(delay - self._delay, -limits.delay_rate * step), limits.delay_rate * step)

    def state_space(self) -> None:
        """Return None: a control that adapts is not linear."""

    def held(self) -> LinearControl:
        """Return the control as it begins, its trim held at gain 1 and no delay."""
        control = self._control
        return control.state_space() if isinstance(control, MpicControl) else control.held()
