"""What adaptive compensators share: derivatives of signals, and coefficients that move slowly and within bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.identified_table import held_table
from bmd_rths_core.compensators.inverse import cascade
from bmd_rths_core.compensators.protocol import Known
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.parameters import parameter
from bmd_rths_core.table.controller import TableMeasurement

FloatArray = NDArray[np.float64]

#: Frequencies of the fit the coefficients begin with.
_POINTS = 200
#: Adaptation waits after a lost measurement until the filters have forgotten it [periods of the lower band edge].
_FORGET = 1.0


class Limits(NamedTuple):
    """Where an adaptation looks, and how far and how fast it may go.

    Parameters
    ----------
    lower_frequency, upper_frequency : float
        Band in which the table is compared with its commands [Hz].
    largest_change : float
        Of each coefficient, relative to the one of the identified table.
    largest_rate : float
        The same per second.
    """

    lower_frequency: float
    upper_frequency: float
    largest_change: float
    largest_rate: float


def adaptive_parameters(name: str) -> float:
    """Return the declaration of a parameter that every adaptive compensator has."""
    texts = {
        "lower_frequency": (0.5, "Lower end of the band in which the table is compared with its commands", "Hz"),
        "upper_frequency": (10.0, "Upper end of that band; below half the rate of the loop", "Hz"),
    }
    default, description, unit = texts[name]
    declared: float = parameter(
        default, description=description, unit=unit, source="tuned on the simulated table", lower=1e-3, upper=5e3
    )
    return declared


def quiet_parameter() -> float:
    """Return the declaration of the motion below which nothing is adapted."""
    declared: float = parameter(
        0.1,
        description="Acceleration of the table in the band, root mean square over the memory, below which nothing is "
        "adapted",
        unit="m/s2",
        source="assumed: twice the noise of an accelerometer",
        lower=0.0,
        upper=1e3,
    )
    return declared


def change_parameter() -> float:
    """Return the declaration of the bound of the coefficients."""
    declared: float = parameter(
        0.3,
        description="Largest change of each coefficient, relative to the one of the identified table",
        unit="1",
        source="assumed",
        lower=0.0,
        upper=10.0,
    )
    return declared


def rate_parameter() -> float:
    """Return the declaration of the rate of the coefficients."""
    declared: float = parameter(
        0.25,
        description="Largest rate of each coefficient, relative to the one of the identified table",
        unit="1/s",
        source="assumed: much slower than the first mode",
        lower=0.0,
        upper=100.0,
    )
    return declared


class Differences:
    """Value and first two derivatives of a signal by backward differences, which add no lag of a filter.

    Parameters
    ----------
    time_step : float
        Δt [s].
    """

    def __init__(self, time_step: float) -> None:
        self._weights = difference_weights(time_step)
        self._values = np.zeros(3)

    def reset(self) -> None:
        """Return to rest."""
        self._values[:] = 0.0

    def step(self, value: float) -> FloatArray:
        """Return value, first and second derivative, shape (3,).

        Parameters
        ----------
        value : float
            Of this step.
        """
        values = self._values
        values[2], values[1], values[0] = values[1], values[0], value
        return np.asarray(self._weights @ values)


def difference_weights(time_step: float) -> FloatArray:
    """Return value, first and second derivative as weights of a value and the two before it, shape (3, 3)."""
    scale = np.array([1.0, 1.0 / time_step, 1.0 / time_step**2])[:, None]
    return np.asarray(scale * np.array([[1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [1.0, -2.0, 1.0]]))


class Sample(NamedTuple):
    """What one step tells about the inverse of the table, all through the same band-pass.

    Parameters
    ----------
    regressors : ndarray, shape (3,)
        Acceleration of the table and its derivatives, scaled by the coefficients to begin with [m/s²].
    command : float
        The command of the same step [m/s²].
    """

    regressors: FloatArray
    command: float


class AdaptiveShaper:
    """u = Σ aⱼ dʲa_N/dtʲ, the coefficients from what the table did with earlier commands.

    Parameters
    ----------
    known : Known
        With an identified table.
    limits : Limits
        Of the adaptation.
    scheme : str
        Name of the compensator.
    rule : Rule
        Where the coefficients are to go.

    Attributes
    ----------
    factors : ndarray, shape (3,)
        Coefficients of this step, relative to those of the identified table.
    """

    def __init__(self, known: Known, limits: Limits, scheme: str, rule: Rule) -> None:
        # scipy.signal takes half a second to import, which the other schemes need not wait.
        from scipy.signal import butter

        self._check(known, limits, scheme)
        self._desired, self._achieved = Differences(known.time_step), Differences(known.time_step)
        self._time_step = known.time_step
        self.initial = inverse_coefficients(known, limits, scheme)
        self._rule, self._limits = rule, limits
        band = (limits.lower_frequency, limits.upper_frequency)
        sections = butter(2, band, "bandpass", fs=1.0 / known.time_step, output="sos")
        self._band = cascade(np.asarray(sections))
        self._waits = math.ceil(_FORGET / limits.lower_frequency / known.time_step)
        self._most = limits.largest_rate * known.time_step
        self.reset()

    @staticmethod
    def _check(known: Known, limits: Limits, scheme: str) -> None:
        lower, upper, half = limits.lower_frequency, limits.upper_frequency, 0.5 / known.time_step
        if not lower < upper < half:
            raise InputError(
                f"{scheme}.lower_frequency, {scheme}.upper_frequency: {lower:g} and {upper:g} Hz are not allowed; one "
                f"below the other, and both below half the rate of the loop, {half:g} Hz, are required"
            )

    @property
    def adapted(self) -> Mapping[str, float]:
        """Factors of the three coefficients of this step, by name."""
        return dict(zip(("acceleration_factor", "jerk_factor", "snap_factor"), self.factors.tolist(), strict=True))

    def reset(self) -> None:
        """Return to rest before step 0, with the coefficients of the identified table."""
        self._desired.reset()
        self._achieved.reset()
        self._rule.reset()
        self._filters = np.zeros((len(self._band.a), 4))
        self.factors = np.ones(3)
        self._before = 0.0
        self._command = 0.0
        self._step, self._measured = -1, -1
        self._pause = 0

    def step(self, desired_acceleration: float) -> float:
        """Return the command of this step."""
        self._step += 1
        weights = self.initial * self.factors
        self._command = float(weights @ self._desired.step(desired_acceleration))
        return self._command

    def learn(self, measurement: TableMeasurement) -> None:
        """Compare the table with the command, and move the coefficients by at most what a step allows."""
        applied, after = measurement.applied_command, measurement.table_acceleration
        lost = self._step - self._measured - 1 > 0 or not (math.isfinite(applied) and math.isfinite(after))
        self._measured = self._step
        if lost:
            self._pause = self._waits
        # The table at the begin of this step, which the command of this step has to go with.
        signals = np.empty(4)
        signals[:3] = self.initial * self._achieved.step(self._before)
        signals[3] = applied if math.isfinite(applied) else self._command
        self._before = after if math.isfinite(after) else self._before
        filtered = (self._band.c @ self._filters + self._band.d * signals)[0]
        self._filters = self._band.a @ self._filters + self._band.b * signals
        if self._pause:
            self._pause -= 1
            return
        wanted = self._rule.wanted(Sample(filtered[:3], float(filtered[3])), self.factors)
        change = np.clip(wanted - self.factors, -self._most, self._most)
        most = self._limits.largest_change
        self.factors = np.clip(self.factors + change, 1.0 - most, 1.0 + most)

    def state_space(self) -> None:
        """Return None: a shaper that adapts is not linear."""

    def held(self, factors: FloatArray | None = None) -> DiscreteStateSpace:
        """Return the shaper as it is without adaptation.

        Parameters
        ----------
        factors : ndarray, shape (3,), optional
            Coefficients relative to those of the identified table; those by default.

        Returns
        -------
        DiscreteStateSpace
            Input desired acceleration, output command [m/s²].
        """
        weights = (self.initial if factors is None else self.initial * factors) @ difference_weights(self._time_step)
        delays = np.array([[0.0, 0.0], [1.0, 0.0]])
        return DiscreteStateSpace(delays, np.array([[1.0], [0.0]]), weights[None, 1:], weights[None, :1])


class Rule(Protocol):
    """Where the coefficients are to go."""

    def reset(self) -> None:
        """Forget the past."""

    def wanted(self, sample: Sample, factors: FloatArray) -> FloatArray:
        """Return the coefficients after a step, relative to those of the identified table, without rate or bounds.

        Parameters
        ----------
        sample : Sample
            What this step tells.
        factors : ndarray, shape (3,)
            Coefficients of this step, relative to those of the identified table.
        """


def inverse_coefficients(known: Known, limits: Limits, scheme: str) -> FloatArray:
    """Return the coefficients that invert the identified table in the band, by least squares.

    Parameters
    ----------
    known : Known
        With an identified table.
    limits : Limits
        The band.
    scheme : str
        Name of the compensator.

    Returns
    -------
    ndarray, shape (3,)
        Least mean of |1 − T Σ aⱼ Dʲ|², T from a command to the table at the begin of the same step, D the backward
        difference [1, s, s²].

    Raises
    ------
    InputError
        No table was identified, or the inverse has no lead.
    """
    hertz = np.linspace(limits.lower_frequency, limits.upper_frequency, _POINTS)
    angles = 2.0 * np.pi * hertz * known.time_step
    basis = np.exp(-1j * np.outer(angles, np.arange(3))) @ difference_weights(known.time_step).T
    rows = held_table(known, scheme).response(angles)[:, None] * basis
    scale = np.linalg.norm(rows, axis=0)
    stacked = np.vstack((rows.real, rows.imag)) / scale
    found = np.linalg.lstsq(stacked, np.append(np.ones(_POINTS), np.zeros(_POINTS)), rcond=None)[0] / scale
    if not (found > 0.0).all():
        raise InputError(
            f"identified_model: its inverse from {limits.lower_frequency:g} to {limits.upper_frequency:g} Hz has "
            f"the coefficients {', '.join(f'{value:.4g}' for value in found)}; scheme {scheme} requires positive ones, "
            "those of a table that lags"
        )
    return np.asarray(found)
