"""Calibration of every sensor: what a reading stands for, applied where the table driver takes a measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]

#: Sensors that are not on a floor, with the unit of what they measure.
CHANNELS = {
    "table_displacement": "m",
    "table_acceleration": "m/s2",
    "actuator_force": "N",
    "base_shear": "N",
}

_LARGEST = 1e9


def _scale(of: str) -> Any:
    return parameter(
        1.0,
        description=f"Scale of the {of}: SI units for one unit of its reading; negative where its polarity is reversed",
        unit="SI unit over unit of the reading",
        source="calibration sheet",
        lower=-_LARGEST,
        upper=_LARGEST,
    )


def _offset(of: str) -> Any:
    return parameter(
        0.0,
        description=f"Reading of the {of} at zero, as bmd-rths commission finds it",
        unit="unit of the reading",
        lower=-_LARGEST,
        upper=_LARGEST,
    )


def _range(of: str, unit: str) -> Any:
    return parameter(0.0, description=f"Full range of the {of}; 0 does not tell it", unit=unit, lower=0.0, upper=1e12)


@dataclass(frozen=True)
class SensorsConfig:
    """Calibration and identity of every sensor: a value is its scale × (reading of the controller − offset)."""

    SECTION: ClassVar[str] = "sensors"

    table_displacement_scale: float = _scale("displacement of the table")
    table_displacement_offset: float = _offset("displacement of the table")
    table_displacement_range: float = _range("displacement of the table", "m")
    table_acceleration_scale: float = _scale("accelerometer of the table")
    table_acceleration_offset: float = _offset("accelerometer of the table")
    table_acceleration_range: float = _range("accelerometer of the table", "m/s2")
    actuator_force_scale: float = _scale("force of the actuator")
    actuator_force_offset: float = _offset("force of the actuator")
    actuator_force_range: float = _range("force of the actuator", "N")
    base_shear_scale: float = _scale("load cells")
    base_shear_offset: float = _offset("load cells")
    base_shear_range: float = _range("load cells", "N")
    floor_scales: tuple[float, ...] = parameter(
        (),
        description="Scales of the accelerometers of the floors, from the table up; none are 1",
        unit="m/s2 over unit of the reading",
        source="calibration sheet",
        lower=-_LARGEST,
        upper=_LARGEST,
    )
    floor_offsets: tuple[float, ...] = parameter(
        (),
        description="Readings of the accelerometers of the floors at zero; none are 0",
        unit="unit of the reading",
        lower=-_LARGEST,
        upper=_LARGEST,
    )
    floor_ranges: tuple[float, ...] = parameter(
        (),
        description="Full ranges of the accelerometers of the floors; none, or 0, do not tell them",
        unit="m/s2",
        lower=0.0,
        upper=1e12,
    )
    identities: str = parameter(
        "not told", description="Makers and serial numbers of the sensors, in the words of the laboratory"
    )
    calibrated_on: str = parameter("not told", description="Date of their calibration, for the bag and the report")

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)
        for name in CHANNELS:
            if getattr(self, f"{name}_scale") == 0.0:
                raise InputError(f"sensors.{name}_scale: 0 is not allowed; a scale other than 0 is required")
        if 0.0 in self.floor_scales:
            raise InputError("sensors.floor_scales: 0 is not allowed; scales other than 0 are required")
        for name in ("identities", "calibrated_on"):
            if not getattr(self, name):
                raise InputError(f"sensors.{name}: empty; text is required")

    def refuse_other_floors(self, floors: int) -> None:
        """Refuse lists that do not have one entry a floor.

        Parameters
        ----------
        floors : int
            Number of floors n.

        Raises
        ------
        InputError
            A list has another number of entries, and is not empty.
        """
        for name in ("floor_scales", "floor_offsets", "floor_ranges"):
            if len(getattr(self, name)) not in (0, floors):
                raise InputError(
                    f"sensors.{name}: {len(getattr(self, name))} entries; {floors}, one a floor of the specimen, or "
                    "none are required"
                )


class Calibration:
    """From readings to SI units, and back.

    Parameters
    ----------
    config : SensorsConfig
        Scales and offsets.
    floors : int
        Number of floors n.

    Raises
    ------
    InputError
        See `SensorsConfig.refuse_other_floors`.
    """

    def __init__(self, config: SensorsConfig, floors: int) -> None:
        config.refuse_other_floors(floors)
        scales = [getattr(config, f"{name}_scale") for name in CHANNELS]
        offsets = [getattr(config, f"{name}_offset") for name in CHANNELS]
        self._scales: FloatArray = np.array([*scales, *(config.floor_scales or (1.0,) * floors)])
        self._offsets: FloatArray = np.array([*offsets, *(config.floor_offsets or (0.0,) * floors)])
        #: True when every value is its reading, to the last bit.
        self.is_identity = bool((self._scales == 1.0).all() and (self._offsets == 0.0).all())

    def calibrated(self, reading: TableMeasurement) -> TableMeasurement:
        """Return what readings stand for.

        Parameters
        ----------
        reading : TableMeasurement
            As the table controller gives it.
        """
        return reading if self.is_identity else _with(reading, self._scales * (_values(reading) - self._offsets))

    def reading(self, measured: TableMeasurement) -> TableMeasurement:
        """Return the readings that stand for a measurement: what a recording has not, it tells with its configuration.

        Parameters
        ----------
        measured : TableMeasurement
            In SI units.
        """
        return measured if self.is_identity else _with(measured, _values(measured) / self._scales + self._offsets)

    def readings(self, name: str, values: FloatArray) -> FloatArray:
        """Return the readings behind the values of one channel.

        Parameters
        ----------
        name : str
            One of `CHANNELS`, or ``"floor_accelerations"``.
        values : ndarray, shape (N,) or (N, n)
            In SI units.
        """
        own = list(CHANNELS).index(name) if name in CHANNELS else slice(len(CHANNELS), None)
        return np.asarray(values / self._scales[own] + self._offsets[own])


def _values(measurement: TableMeasurement) -> FloatArray:
    own = [getattr(measurement, name) for name in CHANNELS]
    return np.concatenate((own, measurement.floor_accelerations))


def _with(measurement: TableMeasurement, values: FloatArray) -> TableMeasurement:
    own = dict(zip(CHANNELS, values[: len(CHANNELS)].tolist(), strict=True))
    return measurement._replace(**own, floor_accelerations=values[len(CHANNELS) :])
