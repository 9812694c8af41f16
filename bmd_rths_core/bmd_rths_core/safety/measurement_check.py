"""The limits of the sensors: displacement, force, tracking error, values that are not finite or do not change."""

from __future__ import annotations

import math
from collections.abc import Callable

from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.stuck_sensors import StuckSensorCheck
from bmd_rths_core.safety.trips import Action, Trip
from bmd_rths_core.table.controller import TableMeasurement

_SENSORS = ("table displacement", "table acceleration", "actuator force", "base shear", "floor accelerations")


class MeasurementCheck:
    """Find the limits that a measurement passes.

    Parameters
    ----------
    config : SafetyConfig
        Limits and actions.
    time_step : float
        Δt [s].

    Notes
    -----
    A sensor that a laboratory lacks is NaN all the time. One that has given a value has to go on, and an infinite value
    is never right.
    """

    def __init__(self, config: SafetyConfig, time_step: float) -> None:
        self._config = config
        self._share = min(1.0, time_step / config.tracking_time)
        self._stuck_sensors = StuckSensorCheck(config, time_step)
        self._actions = {name: config.action(name) for name in ("displacement", "force", "tracking", "non_finite")}
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._mean_square = 0.0
        self._seen = [False] * len(_SENSORS)
        self._stuck_sensors.reset()

    def step(self, measurement: TableMeasurement, explains: Callable[[float], bool]) -> list[Trip]:
        """Return the limits that a measurement passes.

        Parameters
        ----------
        measurement : TableMeasurement
            Sensors at the end of a step.
        explains : callable
            Tells whether the commands explain a displacement of the table [m].
        """
        config, trips, step = self._config, [], measurement.step
        sensor = self._lost_sensor(measurement)
        if sensor is not None:
            name, value = sensor
            trips.append(Trip("safety.non_finite_action", "", name, value, math.nan, step, self._actions["non_finite"]))
        if abs(measurement.table_displacement) > config.displacement_limit:
            trips.append(self._displacement_trip(measurement.table_displacement, step, explains))
        if abs(measurement.actuator_force) > config.force_limit:
            trips.append(self._trip("force", "N", "actuator force", measurement.actuator_force, step))
        error = measurement.applied_command - measurement.table_acceleration
        if math.isfinite(error):
            self._mean_square += self._share * (error * error - self._mean_square)
            if self._mean_square > config.tracking_limit**2:
                trips.append(self._trip("tracking", "m/s2", "tracking error", math.sqrt(self._mean_square), step))
        trips += self._stuck_sensors.step(measurement)
        return [trip for trip in trips if trip.action is not Action.IGNORE] if trips else trips

    def _lost_sensor(self, measurement: TableMeasurement) -> tuple[str, float] | None:
        floors = measurement.floor_accelerations
        values = (
            measurement.table_displacement,
            measurement.table_acceleration,
            measurement.actuator_force,
            measurement.base_shear,
            float(floors.sum()) if len(floors) else math.nan,
        )
        for i, value in enumerate(values):
            if math.isfinite(value):
                self._seen[i] = True
            elif self._seen[i] or math.isinf(value):
                return _SENSORS[i], value
        return None

    def _displacement_trip(self, displacement: float, step: int, explains: Callable[[float], bool]) -> Trip:
        trip = self._trip("displacement", "m", "displacement", displacement, step)
        if trip.action <= Action.INDICATE or explains(displacement):
            return trip
        # The table is not where the commands have led it, so a ramp of commands cannot be trusted either.
        return trip._replace(quantity="displacement, elsewhere than commanded,", action=Action.EMERGENCY_STOP)

    def _trip(self, limit: str, unit: str, quantity: str, value: float, step: int) -> Trip:
        allowed = getattr(self._config, f"{limit}_limit")
        return Trip(f"safety.{limit}_limit", unit, quantity, value, allowed, step, self._actions[limit])
