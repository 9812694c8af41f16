"""Story stiffness of the specimen, found while the test runs, less what the noise of the sensors makes of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.mpic.continuity import Continuity
from bmd_rths_core.compensators.protocol import SensorNoise
from bmd_rths_core.errors import InputError
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]

#: A drift of less than so many times the power of its noise tells nothing.
_DEAD_ZONE = 20.0
#: Nothing is told before this share of the memory is filled.
_FILLED = 0.2


class StiffnessLimits(NamedTuple):
    """Where the adaptation looks, how slowly it moves, and how far it goes.

    Parameters
    ----------
    lower_frequency, upper_frequency : float
        Band of drifts and shears [Hz].
    memory : float
        Time in which the past is forgotten [s].
    least, largest : float
        Bounds of the factors of the stories.
    rate : float
        Largest rate of a factor [1/s].
    """

    lower_frequency: float
    upper_frequency: float
    memory: float
    least: float
    largest: float
    rate: float


class StoryStiffness:
    """Factors θ of the stories of a specimen, from V = −θ k δ − c δ̇.

    Parameters
    ----------
    specimen : ShearBuilding
        Its model, n floors: k and c.
    noise : SensorNoise
        Of the sensors.
    load_cell : bool
        The shear of the lowest story is measured.
    limits : StiffnessLimits
        Of the adaptation.
    time_step : float
        Δt [s].

    Attributes
    ----------
    factors : ndarray, shape (n,)
        θ after the last measurement.

    Notes
    -----
    V of a story is the sum of mᵢ aᵢ from its floor up, its drift δ the double integral of the difference of two
    accelerations, all through one band-pass, so that the table does not enter. The least squares are those of
    exponential forgetting; from their sums the known covariance of the filtered noise is taken away, which would bias
    θ otherwise (Söderström 2007, Automatica 43, 939-958: bias-compensating least squares).
    """

    def __init__(
        self, specimen: ShearBuilding, noise: SensorNoise, load_cell: bool, limits: StiffnessLimits, time_step: float
    ) -> None:
        if not limits.lower_frequency < limits.upper_frequency < 0.5 / time_step:
            raise InputError(
                f"mpic.stiffness_lower_frequency, mpic.stiffness_upper_frequency: {limits.lower_frequency:g} and "
                f"{limits.upper_frequency:g} Hz are not allowed; one below the other, and both below half the rate of "
                f"the loop, {0.5 / time_step:g} Hz, are required"
            )
        self._limits, self._time_step, self._load_cell = limits, time_step, load_cell
        self._stiffness = np.asarray(specimen.stiffnesses)
        self._damping = np.asarray(specimen.damping_coefficients)
        self._signals, deviations = _signals(specimen, noise, load_cell)
        self._filter = _Filter(limits, time_step)
        self._of_noise = self._noise_sums(deviations)
        self._keeps = math.exp(-time_step / limits.memory)
        self._continuity = Continuity(time_step)
        self.reset()

    def _noise_sums(self, deviations: FloatArray) -> FloatArray:
        """Return what noise adds to the means of δ² and of δ (V + c δ̇), shape (2, n)."""
        of_drift, of_rate, of_shear = self._filter.impulse_responses()
        n = len(self._stiffness)
        weights = self._signals * deviations
        drift, shear = weights[:n], weights[n:]
        both = np.sum(drift**2, axis=1)
        crossed = np.sum(drift * shear, axis=1)
        products = crossed * (of_drift @ of_shear) + self._damping * both * (of_drift @ of_rate)
        return np.vstack((both * (of_drift @ of_drift), products))

    def reset(self) -> None:
        """Return to the identified specimen, at rest before step 0."""
        n = len(self._stiffness)
        self.factors = np.ones(n)
        self._state = np.zeros((self._filter.order, 2 * n))
        self._sums, self._filled = np.zeros((2, n)), 0.0
        self._continuity.reset()

    def learn(self, measurement: TableMeasurement) -> None:
        """Take in a measurement, and move the factors by at most what a step allows.

        Parameters
        ----------
        measurement : TableMeasurement
            Of the step after the last one that was taken in, unless some are lost.
        """
        sensors = np.array([measurement.table_acceleration, *measurement.floor_accelerations])
        if self._load_cell:
            sensors = np.append(sensors, measurement.base_shear)
        complete = bool(np.isfinite(sensors).all())
        signals = self._signals @ (sensors if complete else np.zeros(len(sensors)))
        drift, rate, shear = self._filter.step(self._state, signals)
        if not self._continuity.unbroken(measurement.step, complete):
            return
        lost = 1.0 - self._keeps
        self._filled += lost * (1.0 - self._filled)
        self._sums += lost * (np.vstack((drift * drift, drift * (shear + self._damping * rate))) - self._sums)
        known = self._sums - self._filled * self._of_noise
        moves = (self._filled > _FILLED) & (self._sums[0] > (1.0 + _DEAD_ZONE) * self._filled * self._of_noise[0])
        limits, most = self._limits, self._limits.rate * self._time_step
        wanted = np.where(moves, -known[1] / np.where(moves, known[0], 1.0) / self._stiffness, self.factors)
        wanted = np.clip(wanted, limits.least, limits.largest)
        self.factors = self.factors + np.clip(wanted - self.factors, -most, most)


class _Filter:
    """One band-pass B of fourth order for three signals: B / s² and B / s of one, and B of another."""

    def __init__(self, limits: StiffnessLimits, time_step: float) -> None:
        # scipy.signal takes half a second to import, which the other schemes need not wait.
        from scipy.signal import butter

        band = (limits.lower_frequency, limits.upper_frequency)
        _, poles, gain = butter(2, band, "bandpass", fs=1.0 / time_step, output="zpk")
        # The trapezoidal rule, exact in the middle of the band: 1/s becomes τ (z + 1) / (z − 1).
        middle = math.pi * math.sqrt(band[0] * band[1])
        tau = math.tan(middle * time_step) / (2.0 * middle)
        zeros = (
            (gain * tau**2, [-1.0, -1.0, -1.0, -1.0]),
            (gain * tau, [1.0, -1.0, -1.0, -1.0]),
            (gain, [1.0, 1.0, -1.0, -1.0]),
        )
        below = np.real(np.poly(poles))
        above = np.array([factor * np.poly(own) for factor, own in zeros])
        self.order = len(poles)
        self._transition = np.eye(self.order, k=-1)
        self._transition[0] = -below[1:]
        self._through = above[:, 0]
        self._rows = above[:, 1:] - np.outer(above[:, 0], below[1:])
        self._length = math.ceil(20.0 / (band[1] - band[0]) / time_step)

    def step(self, state: FloatArray, signals: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return B/s² and B/s of the first half of the signals and B of the second, and advance their state."""
        outputs = self._rows @ state + self._through[:, None] * signals
        state[:] = self._transition @ state
        state[0] += signals
        half = len(signals) // 2
        return outputs[0, :half], outputs[1, :half], outputs[2, half:]

    def impulse_responses(self) -> FloatArray:
        """Return the three responses to a one, shape (3, steps)."""
        state, responses = np.zeros((self.order, 2)), np.zeros((3, self._length))
        for k in range(self._length):
            responses[:, k] = np.concatenate(self.step(state, np.full(2, float(k == 0))))
        return responses


def _signals(specimen: ShearBuilding, noise: SensorNoise, load_cell: bool) -> tuple[FloatArray, FloatArray]:
    """Return the rows of relative accelerations and of shears over the sensors, and the noise of the sensors.

    The sensors are table, n floors, and the load cell where there is one.
    """
    n = specimen.stories
    drifts = np.eye(n, n + 1, 1) - np.eye(n, n + 1)
    shears = np.hstack((np.zeros((n, 1)), np.triu(np.tile(specimen.masses, (n, 1)))))
    rows, deviations = np.vstack((drifts, shears)), np.full(n + 1, noise.acceleration)
    if not load_cell:
        return rows, deviations
    rows = np.hstack((rows, np.zeros((2 * n, 1))))
    rows[n] = -np.eye(1, n + 2, n + 1)
    return rows, np.append(deviations, noise.shear)
