"""Fit of a rational transfer function of given order to spectral lines, with real coefficients and stable poles.

Vector fitting of averaged lines gives the poles to begin with. It is biased by the averaging, and by noise, because it
multiplies the measured response by an unknown; so the poles are then improved for the smallest weighted output error,
the numerator being the solution of a linear problem for each set of poles (variable projection: Golub and Pereyra 1973,
with the Jacobian of Kaufman 1975).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares

from bmd_rths_core.identification.frequency_response import ComplexArray, FloatArray
from bmd_rths_core.identification.rational_model import RationalModel, denominator_factors
from bmd_rths_core.identification.spectral_lines import SpectralLines
from bmd_rths_core.identification.vector_fitting import shared_poles

_LARGEST_LOGARITHM = 20.0

#: The sum of squares is about the number of lines; a relative change of this size is far below one parameter's worth.
_TOLERANCE = 1e-6
_EVALUATIONS = 60

#: Number of averaged lines that vector fitting is given, at most twice.
_COARSE_LINES = 500

#: Degrees without a better criterion after which the search for a simpler numerator ends: a pair of zeros.
_PATIENCE = 2


class RationalFit:
    """Fits of different structure to the same lines.

    Parameters
    ----------
    lines : SpectralLines
        What is fitted.
    """

    def __init__(self, lines: SpectralLines) -> None:
        self._lines = lines
        self._scale = float(lines.frequencies[-1])
        self._s: ComplexArray = np.asarray(1j * lines.frequencies / self._scale)
        self._values = 2 * np.count_nonzero(lines.weight)
        self._coarse = lines.averaged(1 + len(lines.frequencies) // _COARSE_LINES)
        self._weighted: ComplexArray = np.asarray(lines.weight * lines.response)
        self._powers: FloatArray = np.ones((len(lines.frequencies), 1))
        self._last: tuple[tuple[bytes, int, int] | None, list[_Projection]] = None, []
        self._models: dict[tuple[int, float, bool], RationalModel] = {}

    def model(self, order: int, delay: float = 0.0, *, free_delay: bool = False) -> RationalModel:
        """Return the best model of an order, with numerators of the same degree.

        Parameters
        ----------
        order : int
            Number of poles.
        delay : float
            Pure delay [s].
        free_delay : bool
            The delay is a first guess, which is improved.

        Returns
        -------
        RationalModel
        """
        key = (order, delay, free_delay)
        if key not in self._models:
            guess = np.append(_parameters(self._first_poles(order, delay)), delay * self._scale)
            self._models[key] = self._improved(guess, order, order, free_delay)
        return self._models[key]

    def model_near(self, poles: ComplexArray) -> RationalModel:
        """Return the best model near given poles, without delay, with numerators of the same degree.

        Parameters
        ----------
        poles : ndarray of complex
            Stable poles to begin with [rad/s]; of each complex pair the one with positive imaginary part.

        Returns
        -------
        RationalModel
        """
        guess = _parameters(poles / self._scale)
        return self._improved(np.append(guess, 0.0), len(guess), len(guess), free_delay=False)

    def improved(self, model: RationalModel) -> RationalModel:
        """Return the best model of the same structure near a model of lines with other weights.

        Parameters
        ----------
        model : RationalModel
            Where to begin.

        Returns
        -------
        RationalModel
            The given one, when a delay would become negative.
        """
        found = self._improved(self._parameters_of(model), model.order, model.degree, model.delay > 0.0)
        return found if found.delay >= 0.0 else model

    def simplified(self, model: RationalModel) -> RationalModel:
        """Return the model of the same order with the degree of the numerators that has the best criterion.

        Parameters
        ----------
        model : RationalModel
            A model of these lines.

        Returns
        -------
        RationalModel
            Of the same or of lower degree; its delay is not negative.
        """
        best = simpler = model
        for degree in range(model.degree - 1, -1, -1):
            simpler = self._improved(self._parameters_of(simpler), model.order, degree, model.delay > 0.0)
            if simpler.delay >= 0.0 and self.criterion(simpler) <= self.criterion(best):
                best = simpler
            elif degree <= best.degree - _PATIENCE:
                break
        return best

    def without_slow_poles(self, model: RationalModel, slowest: float) -> RationalModel:
        """Return the best model near a model without its poles below a frequency, and with as many zeros less.

        Parameters
        ----------
        model : RationalModel
            A model of these lines.
        slowest : float
            Frequency, well below that of the lines, below which a pole is a guess [rad/s].

        Returns
        -------
        RationalModel
            The given one where it has no such poles, or no others.
        """
        poles = model.poles[model.poles.imag >= 0.0]
        kept = poles[np.abs(poles) >= slowest]
        if len(kept) == len(poles) or not len(kept):
            return model
        guess = _parameters(kept / self._scale)
        degree = max(0, model.degree - (model.order - len(guess)))
        guess = np.append(guess, model.delay * self._scale)
        found = self._improved(guess, len(guess) - 1, degree, model.delay > 0.0)
        return self.without_slow_poles(found, slowest) if found.delay >= 0.0 else model

    def delayed_model(self, order: int, largest: float) -> RationalModel:
        """Return the best model of an order with a pure delay.

        Parameters
        ----------
        order : int
            Number of poles.
        largest : float
            Largest delay to begin the search at [s].

        Returns
        -------
        RationalModel
            Without a delay where the best one is negative.
        """
        # A search finds the delay from where the phase at the end of the band is less than a quarter turn off.
        guesses = np.arange(1, 2 + int(largest * self._scale / np.pi)) * np.pi / self._scale
        promising = min(guesses, key=lambda delay: self._first_residual(order, delay))
        found = self.model(order, promising, free_delay=True)
        return found if found.delay > 0.0 else self.model(order)

    def criterion(self, model: RationalModel) -> float:
        """Return Schwarz's criterion (BIC): n ln(RSS / n) + k ln n for n weighted values and k parameters.

        Parameters
        ----------
        model : RationalModel
            A model of these lines.

        Returns
        -------
        float
            The smaller the better.
        """
        n = self._values
        return float(n * np.log(self.residual_power(model)) + model.parameters * np.log(n))

    def residual_power(self, model: RationalModel) -> float:
        """Return the mean square of the residuals over their expected standard deviation; 0.5 is mere noise.

        Parameters
        ----------
        model : RationalModel
            A model of these lines.

        Returns
        -------
        float
            Of the real and imaginary parts, each of which has half of the variance.
        """
        error = self._lines.weight * (self._lines.response - model.response(self._lines.frequencies))
        return float(np.sum(np.abs(error) ** 2) / self._values)

    def _first_poles(self, order: int, delay: float) -> ComplexArray:
        """Return poles by vector fitting of averaged lines, whose noise does not mislead it."""
        lines = self._coarse
        s: ComplexArray = np.asarray(1j * lines.frequencies / self._scale)
        advanced = lines.response * np.exp(1j * lines.frequencies * delay)[:, None]
        return shared_poles(s, advanced, lines.weight, order)

    def _first_residual(self, order: int, delay: float) -> float:
        """Return the sum of squares with the poles of vector fitting."""
        parameters = np.append(_parameters(self._first_poles(order, delay)), delay * self._scale)
        return float(np.sum(self._residual(parameters, order, order) ** 2))

    def _parameters_of(self, model: RationalModel) -> FloatArray:
        coefficients = np.log([*model.quadratics.ravel(), *model.linears])
        return np.append(coefficients, model.delay * self._scale)

    def _improved(self, parameters: FloatArray, order: int, degree: int, free_delay: bool) -> RationalModel:
        """Return the model with the smallest output error near the given one."""
        free = order + free_delay
        fixed = parameters[free:]

        def residual(x: FloatArray) -> FloatArray:
            return self._residual(np.append(x, fixed), order, degree)

        def jacobian(x: FloatArray) -> FloatArray:
            return self._jacobian(np.append(x, fixed), order, degree)[:, :free]

        found = least_squares(
            residual, parameters[:free], jacobian, method="lm", max_nfev=_EVALUATIONS, ftol=_TOLERANCE
        )
        return self._model(np.append(found.x, fixed), order, degree)

    def _residual(self, parameters: FloatArray, order: int, degree: int) -> FloatArray:
        rows = []
        for projection in self._projected(parameters, order, degree):
            rows += [
                y - q @ (q.T @ y) for q, y in zip(projection.bases, (projection.y.real, projection.y.imag), strict=True)
            ]
        return np.concatenate(rows)

    def _jacobian(self, parameters: FloatArray, order: int, degree: int) -> FloatArray:
        quadratics, linears, _ = _unpacked(parameters, order)
        factors = denominator_factors(self._s, quadratics, linears)
        pairs = len(quadratics)
        changes = [  # ∂ ln(denominator · e^{sτ}) over the logarithms of a₁ and a₀, and over τ
            *(row for i, (a1, a0) in enumerate(quadratics) for row in (a1 * self._s / factors[i], a0 / factors[i])),
            *(a0 / factors[pairs + i] for i, a0 in enumerate(linears)),
            self._s,
        ]
        over_parameters = np.column_stack(changes)
        blocks = []
        for projection in self._projected(parameters, order, degree):
            even, odd = projection.bases
            fitted = even @ (even.T @ projection.y.real) + 1j * (odd @ (odd.T @ projection.y.imag))
            change = fitted[:, None] * over_parameters
            blocks += [part - q @ (q.T @ part) for q, part in ((even, change.real), (odd, change.imag))]
        return np.vstack(blocks)

    def _projected(self, parameters: FloatArray, order: int, degree: int) -> list[_Projection]:
        """Return every response projected on what numerators of a degree can make of it; the last result is kept."""
        key = (parameters.tobytes(), order, degree)
        if self._last[0] != key:
            quadratics, linears, delay = _unpacked(parameters, order)
            denominator = np.prod(denominator_factors(self._s, quadratics, linears), axis=0)
            size = np.abs(denominator)
            turn = denominator / size
            if delay != 0.0:
                turn = turn * np.exp(self._s * delay)
            if self._powers.shape[1] <= degree:
                self._powers = np.vander(self._s.imag, degree + 1, increasing=True)
            powers = self._powers[:, : degree + 1]
            projections = []
            for weight, weighted in zip(self._lines.weight.T, self._weighted.T, strict=True):
                # Turned by the phase of the denominator, s^d / denominator is real for even d, imaginary for odd d.
                columns = (weight / size)[:, None] * powers
                (even, of_even), (odd, of_odd) = np.linalg.qr(columns[:, 0::2]), np.linalg.qr(columns[:, 1::2])
                projections.append(_Projection((even, odd), (of_even, of_odd), turn * weighted))
            self._last = key, projections
        return self._last[1]

    def _model(self, parameters: FloatArray, order: int, degree: int) -> RationalModel:
        quadratics, linears, delay = _unpacked(parameters, order)
        projections = self._projected(parameters, order, degree)
        numerators = np.empty((degree + 1, len(projections)))
        for j, projection in enumerate(projections):
            for first, y in enumerate((projection.y.real, projection.y.imag)):
                solved = solve_triangular(projection.triangles[first], projection.bases[first].T @ y)
                numerators[first::2, j] = solved * (-1.0) ** np.arange(len(solved))
        return RationalModel(self._scale, quadratics, linears, numerators, delay / self._scale)


class _Projection(NamedTuple):
    """One response, weighted and turned, with the orthonormal bases of its real and of its imaginary part."""

    bases: tuple[FloatArray, FloatArray]
    triangles: tuple[FloatArray, FloatArray]
    y: ComplexArray


def _parameters(poles: ComplexArray) -> FloatArray:
    """Return the logarithms of the coefficients of the factors: all positive, so that every pole is stable."""
    pairs = [(-2.0 * pole.real, abs(pole) ** 2) for pole in poles if pole.imag != 0.0]
    real = sorted(-pole.real for pole in poles if pole.imag == 0.0)
    pairs += [(one + two, one * two) for one, two in zip(real[0::2], real[1::2], strict=False)]
    single = real[-1:] if len(real) % 2 else []
    return np.log([*(coefficient for pair in pairs for coefficient in pair), *single])


def _unpacked(parameters: FloatArray, order: int) -> tuple[FloatArray, FloatArray, float]:
    # Beyond these limits a factor is a constant within the band; a search may not run on until it overflows.
    coefficients = np.exp(np.clip(parameters[:order], -_LARGEST_LOGARITHM, _LARGEST_LOGARITHM))
    pairs = 2 * (order // 2)
    return coefficients[:pairs].reshape(-1, 2), coefficients[pairs:], float(parameters[order])
