"""Simulated sensors on the table and the specimen: noise by seed, quantisation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]

#: Steps whose noise is drawn at once: the same numbers as one step at a time, in a tenth of the time.
_DRAWN = 128


class Sensors:
    """Accelerometers of table and floors, load cells, displacement of the table and force of the actuator.

    Parameters
    ----------
    floors : int
        Number of floors n.
    acceleration_noise : float
        Noise of every accelerometer, root mean square [m/s²].
    acceleration_resolution : float
        Quantisation step of every accelerometer, 0 for none [m/s²].
    shear_noise : float
        Noise of the load cells, root mean square [N].
    displacement_noise : float
        Noise of the displacement, root mean square [m].
    force_noise : float
        Noise of the force of the actuator, root mean square [N].
    seed : int
        Seed of the noise. Displacement and force have a random stream of their own.
    """

    def __init__(
        self,
        floors: int,
        acceleration_noise: float,
        acceleration_resolution: float,
        shear_noise: float,
        displacement_noise: float,
        force_noise: float,
        seed: int,
    ) -> None:
        self._seed = seed
        self._drive_noise = np.array((displacement_noise, force_noise))
        self._noise = np.full(floors + 2, acceleration_noise)
        self._noise[-1] = shear_noise
        self._resolution = acceleration_resolution
        self.reset()

    def reset(self) -> None:
        """Start the noise again from the seed."""
        self._random, self._drive_random = noise_streams(self._seed)
        self._drawn: Iterator[tuple[FloatArray, float, list[float]]] = iter(())

    def read(
        self,
        step: int,
        applied_command: float,
        displacement: float,
        accelerations: FloatArray,
        actuator_force: float,
        base_shear: float,
    ) -> TableMeasurement:
        """Return what the sensors say of the true motion.

        Parameters
        ----------
        step : int
            Step index.
        applied_command : float
            Acceleration command that was applied [m/s²].
        displacement : float
            Displacement of the table [m].
        accelerations : ndarray, shape (1 + n,)
            Absolute accelerations of the table and the floors [m/s²].
        actuator_force : float
            Force of the actuator [N].
        base_shear : float
            Interface shear [N].
        """
        drawn = next(self._drawn, None)
        if drawn is None:
            self._drawn = self._draw()
            drawn = next(self._drawn)
        noise, of_shear, (of_displacement, of_force) = drawn
        sensed = accelerations + noise
        if self._resolution > 0.0:
            sensed = np.round(sensed / self._resolution) * self._resolution
        return TableMeasurement(
            step=step,
            applied_command=applied_command,
            table_displacement=displacement + of_displacement,
            table_acceleration=float(sensed[0]),
            actuator_force=actuator_force + of_force,
            base_shear=base_shear + of_shear,
            floor_accelerations=sensed[1:],
        )

    def _draw(self) -> Iterator[tuple[FloatArray, float, list[float]]]:
        """Return the noise of the next steps: of the accelerometers, the load cells, and displacement and force."""
        noise = self._noise * self._random.standard_normal((_DRAWN, len(self._noise)))
        drives = self._drive_noise * self._drive_random.standard_normal((_DRAWN, 2))
        return zip(noise[:, :-1], noise[:, -1].tolist(), drives.tolist(), strict=True)


def noise_streams(seed: int) -> tuple[np.random.Generator, np.random.Generator]:
    """Return the random streams of a seed: accelerometers and load cells, then displacement and force.

    Two streams, so that the noise of the one pair does not depend on whether the other is read.

    Parameters
    ----------
    seed : int
        Of the run.
    """
    return np.random.default_rng(seed), np.random.default_rng((seed, 1))
