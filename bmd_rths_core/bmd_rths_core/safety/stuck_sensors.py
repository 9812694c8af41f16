"""A sensor that keeps its value while the table is moved."""

from __future__ import annotations

import math

from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.trips import Action, Trip
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import most_steps

#: A table counts as moved while the mean square of the command (1 s) is above the square of this [m/s²]: more than
#: the resolution of any sensor.
_MOVED = 0.05

_MEAN_TIME = 1.0

_SENSORS = ("table displacement", "table acceleration", "actuator force", "base shear")


class StuckSensorCheck:
    """Find the sensors that keep their value.

    Parameters
    ----------
    config : SafetyConfig
        Limit and action.
    time_step : float
        Δt [s].

    Notes
    -----
    Noise and motion change the last digits of a sensor with every step. One that has never changed is a channel that a
    laboratory lacks, as one that has always been NaN.
    """

    def __init__(self, config: SafetyConfig, time_step: float) -> None:
        self._limit = config.stuck_time
        self._tolerated = most_steps(config.stuck_time, time_step)
        self._time_step = time_step
        self._action = config.action("stuck")
        self._share = min(1.0, time_step / _MEAN_TIME)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._mean_square = 0.0
        self._last: list[float] = []
        self._same: list[int] = []
        self._changed: list[bool] = []

    def step(self, measurement: TableMeasurement) -> list[Trip]:
        """Return the trip of a stuck sensor, if there is one.

        Parameters
        ----------
        measurement : TableMeasurement
            Sensors at the end of a step.
        """
        values = [*measurement[2:6], *measurement.floor_accelerations.tolist()]
        if len(values) != len(self._last):
            self._same, self._changed = [0] * len(values), [False] * len(values)
        elif self._action is not Action.IGNORE:
            command = measurement.applied_command if math.isfinite(measurement.applied_command) else 0.0
            self._mean_square += self._share * (command * command - self._mean_square)
            moved = self._mean_square > _MOVED**2
            for i, (value, last) in enumerate(zip(values, self._last, strict=True)):
                if value != last:
                    self._same[i] = 0
                    self._changed[i] = True
                elif moved and self._changed[i]:
                    self._same[i] += 1
        self._last = values
        longest = max(self._same)
        return [self._trip(self._same.index(longest), measurement)] if longest > self._tolerated else []

    def _trip(self, sensor: int, measurement: TableMeasurement) -> Trip:
        floor = 1 + sensor - len(_SENSORS)
        name = f"acceleration of floor {floor}" if floor > 0 else _SENSORS[sensor]
        quantity = f"time in which the {name} stayed {self._last[sensor]:.6g}:"
        time = self._same[sensor] * self._time_step
        return Trip("safety.stuck_time", "s", quantity, time, self._limit, measurement.step, self._action)
