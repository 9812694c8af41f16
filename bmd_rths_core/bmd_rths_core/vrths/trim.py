"""Find gain and lag of an actuator while it moves, and trim its command so that it answers as the nominal one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.runge_kutta import runge_kutta_4
from bmd_rths_core.vrths.problem import DISPLACEMENT_NOISE, NOMINAL, RATE, TIME_STEP, actuator_model

FloatArray = NDArray[np.float64]

#: Steps whose mean is one sample of the estimation.
_MEAN_OF = 16
#: Band in which the actuator is compared with its model [Hz].
_BAND = (0.5, 12.0)
#: Deviations of gain and lag before anything is measured, relative: those of the drawn plants.
_PRIOR = 0.03
#: Assumed power of the errors, times that of the noise in the band: neighbouring samples know the same.
_CAUTION = 50.0


class Trim:
    """u_applied = α ξ + β ξ̇ with ξ = u / (1 + τ s), in p lanes.

    With the slowest pole of the nominal actuator at −1/τ, an actuator of gain 1/α and lag β/α for 1 and τ answers u as
    the nominal one does. α and β come from least squares of the nominal answer y to the applied command,
    y + τ ẏ = α m + β ṁ, m the measured displacement, with the spread of the drawn plants as what is known before.

    Parameters
    ----------
    lanes : int
        p.

    Attributes
    ----------
    gain, lag : ndarray, shape (p,)
        α [1] and β [s], as they are in this step.
    """

    def __init__(self, lanes: int) -> None:
        # scipy.signal takes half a second to import, which the other schemes need not wait.
        from scipy.signal import butter

        model = actuator_model(NOMINAL)
        step = runge_kutta_4(model.a, model.b, TIME_STEP)
        self._phi, self._gamma, self._displacement = step.phi, step.gamma_0 + step.gamma_1, model.displacement
        self._velocity = model.displacement @ model.a
        poles = np.linalg.eigvals(model.a)
        self._time_constant = -1.0 / float(poles[np.isreal(poles)].real.max())
        self._forget = -math.expm1(-TIME_STEP / self._time_constant)
        self._b, self._a = butter(2, _BAND, "bandpass", fs=RATE / _MEAN_OF)
        self._noise = _CAUTION * DISPLACEMENT_NOISE * 2.0 * _BAND[1]
        self._lanes = lanes
        self.reset()

    def reset(self) -> None:
        """Return to rest, with the nominal actuator."""
        lanes = self._lanes
        self.gain, self.lag = np.ones(lanes), np.full(lanes, self._time_constant)
        self._filtered = np.zeros(lanes)
        self._answer = np.zeros((len(self._phi), lanes))
        self._sum, self._summed = np.zeros((2, lanes)), 0
        self._memory = np.zeros((4, 2, lanes))
        self._seen: list[FloatArray] = []
        self._change = np.zeros((2, lanes))
        self._covariance = np.zeros((2, 2, lanes)) + _PRIOR**2 * np.eye(2)[..., None]

    def applied(self, command: FloatArray, measured: FloatArray) -> FloatArray:
        """Return the command to apply in this step.

        Parameters
        ----------
        command : ndarray, shape (p,)
            What a nominal actuator would get [m].
        measured : ndarray, shape (p,)
            Displacement at the begin of the step [m].
        """
        self._sum[0] += (self._displacement + self._time_constant * self._velocity) @ self._answer
        self._sum[1] += measured
        self._summed += 1
        if self._summed == _MEAN_OF:
            self._compare(self._sum / _MEAN_OF)
            self._sum[:], self._summed = 0.0, 0
        rising = command - self._filtered
        applied = self.gain * self._filtered + self.lag / self._time_constant * rising
        self._filtered = self._filtered + self._forget * rising
        self._answer = self._phi @ self._answer + self._gamma * applied
        return np.asarray(applied)

    def _compare(self, sample: FloatArray) -> None:
        """Take a sample of nominal answer and displacement through the band-pass, and move gain and lag."""
        memory, b, a = self._memory, self._b, self._a
        passed = b[0] * sample + memory[0]
        for i in range(3):
            memory[i] = b[i + 1] * sample - a[i + 1] * passed + memory[i + 1]
        memory[3] = b[4] * sample - a[4] * passed
        self._seen = [*self._seen[-2:], passed]
        if len(self._seen) < 3:
            return
        before, now, after = self._seen
        rate = self._time_constant * (after[1] - before[1]) / (2.0 * _MEAN_OF * TIME_STEP)
        regressors = np.stack((now[1], rate))
        error = now[0] - regressors.sum(axis=0) - np.einsum("jl,jl->l", regressors, self._change)
        spread = np.einsum("ijl,jl->il", self._covariance, regressors)
        weight = spread / (self._noise + np.einsum("jl,jl->l", regressors, spread))
        self._change = self._change + weight * error
        self._covariance -= weight[:, None] * spread[None]
        self.gain, self.lag = 1.0 + self._change[0], self._time_constant * (1.0 + self._change[1])
