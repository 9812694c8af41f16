"""Adaptive model-based compensation (Chen, Chang, Spencer and Tsai 2015, Bull. Earthquake Eng. 13, 1633-1653).

doi 10.1007/s10518-014-9681-2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.adaptation import (
    AdaptiveShaper,
    Limits,
    Sample,
    adaptive_parameters,
    change_parameter,
    quiet_parameter,
    rate_parameter,
)
from bmd_rths_core.compensators.protocol import Compensator, Known
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import POSITIVE_FACTOR

FloatArray = NDArray[np.float64]

#: Time over which the motion is judged as quiet or not [s].
_MEMORY = 1.0


@dataclass(frozen=True)
class AdaptiveModelBasedConfig:
    """Band, gain and bounds of the adaptation."""

    SECTION: ClassVar[str] = "amb"

    lower_frequency: float = adaptive_parameters("lower_frequency")
    upper_frequency: float = adaptive_parameters("upper_frequency")
    adaptation_rate: float = parameter(
        1.0,
        description="Rate at which the coefficients follow their gradient, normalised by the power of the motion",
        unit="1/s",
        source="tuned on the simulated table",
        **POSITIVE_FACTOR,
    )
    quiet_acceleration: float = quiet_parameter()
    largest_change: float = change_parameter()
    largest_rate: float = rate_parameter()

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)


class NormalisedGradient:
    """θ⁺ = θ + γ Δt φ (u − φᵀ θ) / p with p the mean power of φ.

    Parameters
    ----------
    rate : float
        γ [1/s].
    quiet : float
        Motion, root mean square, below which the coefficients stay [m/s²].
    time_step : float
        Δt [s].
    """

    def __init__(self, rate: float, quiet: float, time_step: float) -> None:
        self._gain, self._forget = rate * time_step, min(1.0, time_step / _MEMORY)
        self._quiet = quiet**2
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._power = np.zeros(2)

    def wanted(self, sample: Sample, factors: FloatArray) -> FloatArray:
        """Return the coefficients one step down the gradient of the squared error of the inverse model.

        Parameters
        ----------
        sample : Sample
            What this step tells.
        factors : ndarray, shape (3,)
            Coefficients of this step, relative to those of the identified table.
        """
        regressors, command = sample
        now = np.array([regressors[0] ** 2, regressors @ regressors])
        self._power += self._forget * (now - self._power)
        if self._power[0] <= self._quiet:
            return factors
        # Never more than what makes the error of this step vanish, however sudden the motion is.
        power = max(float(self._power[1]), self._gain * float(now[1]))
        error = command - float(regressors @ factors)
        return factors + self._gain * error / power * regressors


def make_adaptive_model_based(known: Known) -> AdaptiveShaper:
    """Return the adaptive model-based compensator, with the coefficients of the identified table to begin with."""
    settings: AdaptiveModelBasedConfig = known.settings
    rule = NormalisedGradient(settings.adaptation_rate, settings.quiet_acceleration, known.time_step)
    band = settings.lower_frequency, settings.upper_frequency
    limits = Limits(*band, settings.largest_change, settings.largest_rate)
    return AdaptiveShaper(known, limits, "amb", rule)


COMPENSATORS = (
    Compensator(
        "amb",
        "Adaptive inverse model of second order, moved down the gradient of its error",
        "The identified table, which has to lag, and its accelerometer; takes no preview",
        shaper=make_adaptive_model_based,
        settings=AdaptiveModelBasedConfig,
    ),
)
