"""Model of the table from measured responses: transfer function of the order the data bear, delay, quality."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.excited_table import Responses
from bmd_rths_core.identification.frequency_response import (
    ComplexArray,
    FloatArray,
    FrequencyResponse,
    hold,
    without_hold,
)
from bmd_rths_core.identification.rational_fit import RationalFit
from bmd_rths_core.identification.rational_model import RationalModel
from bmd_rths_core.identification.sections import sections_of
from bmd_rths_core.identification.spectral_lines import (
    SpectralLines,
    averaged_response,
    coherence_summary,
    spectral_lines,
)

LARGEST_ORDER = 12

#: A pure delay is looked for up to this one [s].
_LARGEST_DELAY = 0.05

#: Poles so far below the lowest line are left out: a zero beside one, of either sign, would have the table answer slow
#: commands as nothing has shown, and the lines do without both.
_SLOWEST = 0.1

#: Orders without a better criterion after which the search ends.
_PATIENCE = 2


@dataclass(frozen=True)
class Delay:
    """Delay of a table over a band.

    Parameters
    ----------
    seconds : float
        Slope of the phase through the origin, fitted by least squares with the coherence as weight [s].
    steps : float
        The same in time steps: α of the command shaper.
    smallest, largest : float
        Smallest and largest −phase / ω in the band [s].
    """

    seconds: float
    steps: float
    smallest: float
    largest: float


@dataclass(frozen=True)
class TableModel:
    """An identified table.

    Parameters
    ----------
    rational : RationalModel
        Transfer function and pure delay.
    criterion : Mapping of int to float
        BIC of each order that was tried, with its best numerator and delay.
    measured : FrequencyResponse
        Welch estimate within the band, shape (n, 1).
    fit_error : float
        Coherence-weighted root mean square of measured minus model, over that of measured.
    residual : float
        Root mean square of the residuals over their expected size; 1 is mere noise.
    delay : Delay
        Equivalent delay.
    """

    rational: RationalModel
    criterion: dict[int, float]
    measured: FrequencyResponse
    fit_error: float
    residual: float
    delay: Delay

    @property
    def sections(self) -> tuple[float, ...]:
        """Sections as `simulated_table.sections` has them."""
        return sections_of(self.rational)

    def summary(self) -> dict[str, Any]:
        """Return what was found as plain values, frequencies in Hz and delays in ms."""
        return {
            "order": self.rational.order,
            "numerator_degree": self.rational.degree,
            "poles": [[pole.real, pole.imag] for pole in self.rational.poles.tolist()],
            "command_delay_ms": 1e3 * self.rational.delay,
            "criterion": {str(order): value for order, value in self.criterion.items()},
            "fit_error_percent": 100.0 * self.fit_error,
            "residual_over_noise": self.residual,
            "delay": {
                "steps": self.delay.steps,
                "ms": 1e3 * self.delay.seconds,
                "smallest_ms": 1e3 * self.delay.smallest,
                "largest_ms": 1e3 * self.delay.largest,
            },
            "coherence": coherence_summary(self.measured),
        }

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Return the sections of a configuration that make up this model."""
        return {
            "command_shaper": {"lead_time": round(self.delay.seconds, 6)},
            "simulated_table": {
                "dynamics": "sections",
                "sections": list(self.sections),
                "command_delay": self.rational.delay,
            },
        }


def identify_table(
    responses: Responses,
    band: tuple[float, float],
    delay_band: tuple[float, float],
    order: int | None = None,
) -> TableModel:
    """Identify the transfer function from the command to the acceleration of the table.

    Parameters
    ----------
    responses : Responses
        Measured responses.
    band : (float, float)
        Band of the fit [rad/s].
    delay_band : (float, float)
        Band over which the delay is taken [rad/s].
    order : int, optional
        Number of poles, 1 to `LARGEST_ORDER`; chosen by BIC without it.

    Returns
    -------
    TableModel

    Raises
    ------
    InputError
        The order is not allowed, too little of the band is coherent, or the table moves against its command.
    """
    if order is not None and not 1 <= order <= LARGEST_ORDER:
        raise InputError(f"order: {order} is not allowed; >= 1 and <= {LARGEST_ORDER} is required")
    averaged = averaged_response(responses.command, responses.table[:, None], responses.time_step, band)
    raw = spectral_lines(responses.command, responses.table[:, None], responses.time_step, averaged)
    held = hold(raw.frequencies, responses.time_step)[:, None]
    lines = SpectralLines(raw.frequencies, raw.response / held, raw.weight * np.abs(held))
    measured = without_hold(averaged, responses.time_step)
    return fitted_model(lines, measured, delay_band, responses.time_step, order)


def fitted_model(
    lines: SpectralLines,
    measured: FrequencyResponse,
    delay_band: tuple[float, float],
    time_step: float,
    order: int | None = None,
    highest: int = LARGEST_ORDER,
) -> TableModel:
    """Return the model of a table that fits spectral lines.

    Parameters
    ----------
    lines : SpectralLines
        What is fitted, shape (n, 1).
    measured : FrequencyResponse
        What the fit is judged by, shape (n, 1).
    delay_band : (float, float)
        Band over which the delay is taken [rad/s].
    time_step : float
        Δt [s].
    order : int, optional
        Number of poles; chosen by BIC without it.
    highest : int
        Largest number of poles to choose.

    Raises
    ------
    InputError
        The table moves against its command.
    """
    fit = RationalFit(lines)
    first, criterion = _best_model(fit, order, highest)
    reweighted = RationalFit(lines.reweighted(first.response(lines.frequencies)))
    model = reweighted.improved(first)
    if order is None:
        model = reweighted.without_slow_poles(model, _SLOWEST * float(lines.frequencies[0]))
    difference = measured.response - model.response(measured.frequencies)
    error = np.sum(measured.coherence * np.abs(difference) ** 2)
    error /= np.sum(measured.coherence * np.abs(measured.response) ** 2)
    return TableModel(
        rational=model,
        criterion=criterion,
        measured=measured,
        fit_error=float(np.sqrt(error)),
        residual=float(np.sqrt(2.0 * fit.residual_power(model))),
        delay=_delay(model, measured, delay_band, time_step),
    )


def _best_model(fit: RationalFit, order: int | None, highest: int) -> tuple[RationalModel, dict[int, float]]:
    """Raise the order until the criterion no longer improves, then lower it as far as a pure delay makes up for it."""
    if order is not None:
        models = {order: min(fit.model(order), fit.delayed_model(order, _LARGEST_DELAY), key=fit.criterion)}
    else:
        models = _until_worse(fit.model, fit, range(1, highest + 1))
        up_to_best = range(_best_order(fit, models), 0, -1)
        delayed = _until_worse(lambda tried: fit.delayed_model(tried, _LARGEST_DELAY), fit, up_to_best)
        models |= {tried: min(model, models[tried], key=fit.criterion) for tried, model in delayed.items()}
    models = {tried: models[tried] for tried in sorted(models)}
    best = _best_order(fit, models)
    # A delay may make up for zeros that are about to go.
    models[best] = min(fit.simplified(models[best]), fit.simplified(fit.model(best)), key=fit.criterion)
    return models[best], {tried: fit.criterion(model) for tried, model in models.items()}


def _until_worse(model: Callable[[int], RationalModel], fit: RationalFit, orders: range) -> dict[int, RationalModel]:
    """Return the models of some orders, up to `_PATIENCE` orders behind the best of them."""
    models: dict[int, RationalModel] = {}
    for tried in orders:
        models[tried] = model(tried)
        if abs(tried - _best_order(fit, models)) >= _PATIENCE:
            break
    return models


def _best_order(fit: RationalFit, models: dict[int, RationalModel]) -> int:
    return min(models, key=lambda tried: fit.criterion(models[tried]))


def _delay(model: RationalModel, measured: FrequencyResponse, band: tuple[float, float], time_step: float) -> Delay:
    inside = measured.between(*band)
    if not len(inside.frequencies):
        raise InputError(
            f"no line was measured from {band[0] / (2 * np.pi):g} to {band[1] / (2 * np.pi):g} Hz to take the delay at"
        )
    phase = _phase(model, float(measured.frequencies[0]), inside.frequencies)
    weight = inside.coherence[:, 0] * inside.frequencies
    seconds = -float(np.sum(weight * phase) / np.sum(weight * inside.frequencies))
    over_frequency = -phase / inside.frequencies
    return Delay(seconds, seconds / time_step, float(over_frequency.min()), float(over_frequency.max()))


def _phase(model: RationalModel, lowest: float, frequencies: FloatArray) -> FloatArray:
    """Return the phase followed up from the lowest frequency that was measured: below it the model is a guess [rad]."""
    grid = np.linspace(lowest, frequencies[-1], 20 * len(frequencies))
    response: ComplexArray = model.response(grid)[:, 0]
    if response[0].real <= 0.0:
        raise InputError("the table moves against its command; the polarity of command or accelerometer is wrong")
    return np.asarray(np.interp(frequencies, grid, np.unwrap(np.angle(response))))
