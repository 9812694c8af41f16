"""Shear estimator: interface shear from the sensors of the table (Eq. 6), by Kalman filter or from load cells."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace, first_order_hold, zero_order_hold
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import VARIANCE
from bmd_rths_core.stages.filterpy_loader import kalman_filter_class
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.table.controller import TableMeasurement

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ShearEstimatorConfig:
    """Where the interface shear comes from, and how much the Kalman filter trusts model and sensors."""

    SECTION: ClassVar[str] = "shear_estimator"

    source: str = parameter(
        "kalman",
        description="Interface shear from the Kalman estimate of the floor accelerations, or from load cells",
        source="Chen et al. 2020, below Eq. 6",
        choices=("kalman", "load_cell"),
    )
    sensor_noise: float = parameter(
        0.0524,
        description="Accelerometer noise the filter assumes, root mean square",
        unit="m/s2",
        source="Chen et al. 2020",
        **VARIANCE,
    )
    model_error: float = parameter(
        0.1,
        description="Unmodelled acceleration of every floor the filter assumes, root mean square, white over the steps",
        unit="m/s2",
        source="tuned on the simulated table",
        **VARIANCE,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)


class ShearEstimator:
    """Estimate the interface shear f = −Σ mᵢ aᵢ at the end of a step.

    The filter's model is the specimen on a base that moves with the measured table acceleration, taken as linear
    between the steps; its measurements are the absolute floor accelerations. Model and noise do not change with time,
    so the filter runs with its steady-state gain, from the discrete algebraic Riccati equation.

    Parameters
    ----------
    config : ShearEstimatorConfig
        Source and noise levels.
    specimen : LinearBuilding
        Model of the experimental substructure, n floors.
    time_step : float
        Δt [s].
    """

    def __init__(self, config: ShearEstimatorConfig, specimen: LinearBuilding, time_step: float) -> None:
        self._from_load_cell = config.source == "load_cell"
        self._filter, self._input_matrix = kalman_filter(config, specimen, time_step)
        self._shear_row = -np.asarray(specimen.masses) @ self._filter.H
        self._input = np.zeros(2)

    def reset(self) -> None:
        """Return to rest."""
        self._filter.x = np.zeros(self._filter.dim_x)
        self._input[:] = 0.0

    def step(self, measurement: TableMeasurement) -> float:
        """Return the interface shear of a step.

        Parameters
        ----------
        measurement : TableMeasurement
            Sensors at the end of the step.

        Returns
        -------
        float
            f [N], with the sign of Eq. 6.
        """
        if self._from_load_cell:
            return measurement.base_shear
        self._input[0] = self._input[1]
        self._input[1] = measurement.table_acceleration
        self._filter.predict_steadystate(self._input, self._input_matrix)
        self._filter.update_steadystate(measurement.floor_accelerations)
        return float(self._shear_row.dot(self._filter.x))


def estimator_state_space(
    config: ShearEstimatorConfig, specimen: LinearBuilding, time_step: float
) -> DiscreteStateSpace:
    """Return the stage as a linear system.

    Parameters
    ----------
    config : ShearEstimatorConfig
        Source and noise levels.
    specimen : LinearBuilding
        Model of the experimental substructure, n floors.
    time_step : float
        Δt [s].

    Returns
    -------
    DiscreteStateSpace
        Inputs table acceleration, n floor accelerations [m/s²] and load cells [N]; output shear [N]. The state is the
        estimate and the table acceleration of the step before.
    """
    size, n = 2 * specimen.stories, specimen.stories
    if config.source == "load_cell":
        load_cell = np.append(np.zeros(n + 1), 1.0)[None, :]
        return DiscreteStateSpace(np.zeros((0, 0)), np.zeros((0, n + 2)), np.zeros((1, 0)), load_cell)
    steady = steady_state_filter(config, specimen, time_step)
    # Update after prediction: x + K (z − H x) with the predicted x.
    correction = np.eye(size) - steady.gain @ steady.measurement
    before, now = (correction @ column[:, None] for column in steady.input_matrix.T)
    a = np.vstack((np.hstack((correction @ steady.transition, before)), np.zeros((1, size + 1))))
    b = np.vstack((np.hstack((now, steady.gain, np.zeros((size, 1)))), np.eye(1, n + 2)))
    # The shear is that of the new estimate, which is the state after this step.
    shear = np.append(-np.asarray(specimen.masses) @ steady.measurement, 0.0)[None, :]
    return DiscreteStateSpace(a, b, shear @ a, shear @ b)


class SteadyStateFilter(NamedTuple):
    """Kalman filter in its steady state. The state is displacements and velocities relative to the table.

    Parameters
    ----------
    transition : ndarray, shape (2n, 2n)
        F.
    input_matrix : ndarray, shape (2n, 2)
        For the table acceleration at the beginning and at the end of the step.
    measurement : ndarray, shape (n, 2n)
        H: absolute floor accelerations.
    process_noise : ndarray, shape (2n, 2n)
        Q.
    measurement_noise : ndarray, shape (n, n)
        R.
    gain : ndarray, shape (2n, n)
        K.
    covariance : ndarray, shape (2n, 2n)
        P after the update.
    """

    transition: FloatArray
    input_matrix: FloatArray
    measurement: FloatArray
    process_noise: FloatArray
    measurement_noise: FloatArray
    gain: FloatArray
    covariance: FloatArray


@lru_cache(maxsize=4)
def steady_state_filter(config: ShearEstimatorConfig, specimen: LinearBuilding, time_step: float) -> SteadyStateFilter:
    """Return the Kalman filter for a specimen, by the discrete algebraic Riccati equation.

    Parameters
    ----------
    config : ShearEstimatorConfig
        Noise levels.
    specimen : LinearBuilding
        Model of the experimental substructure, n floors.
    time_step : float
        Δt [s].

    Returns
    -------
    SteadyStateFilter

    Notes
    -----
    Process noise is the noise of the table accelerometer, entering through the input, plus the unmodelled floor
    accelerations, held over the step.
    """
    a, base_input, floors = specimen.relative_motion()
    n = specimen.stories
    phi, gamma_0, gamma_1 = first_order_hold(a, base_input, time_step)
    _, unmodelled = zero_order_hold(a, np.vstack((np.zeros((n, n)), np.eye(n))), time_step)
    inputs = np.hstack((gamma_0, gamma_1))
    measurement_noise = config.sensor_noise**2 * np.eye(n)
    process_noise = config.sensor_noise**2 * inputs @ inputs.T + config.model_error**2 * unmodelled @ unmodelled.T
    try:
        from scipy.linalg import solve_discrete_are  # as in `integration.discretisation`, not before it is needed

        prior = solve_discrete_are(phi.T, floors.T, process_noise, measurement_noise)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise InputError(
            f"shear_estimator: no Kalman filter with sensor_noise {config.sensor_noise:g} m/s2 and model_error "
            f"{config.model_error:g} m/s2 for this specimen: {' '.join(str(error).split())}"
        ) from error
    gain = np.linalg.solve(floors @ prior @ floors.T + measurement_noise, floors @ prior).T
    covariance = prior - gain @ floors @ prior
    steady = SteadyStateFilter(phi, inputs, floors, process_noise, measurement_noise, gain, covariance)
    for array in steady:  # whoever asks for the same filter gets it
        array.setflags(write=False)
    return steady


def kalman_filter(
    config: ShearEstimatorConfig, specimen: LinearBuilding, time_step: float
) -> tuple[KalmanFilter, FloatArray]:
    """Return filterpy's Kalman filter for a specimen, at rest, with steady-state covariance and gain.

    Parameters
    ----------
    config : ShearEstimatorConfig
        Noise levels.
    specimen : LinearBuilding
        Model of the experimental substructure, n floors.
    time_step : float
        Δt [s].

    Returns
    -------
    filter : filterpy.kalman.KalmanFilter
        State and measurement as `SteadyStateFilter` has them.
    input_matrix : ndarray, shape (2n, 2)
        For the table acceleration at the beginning and at the end of the step.
    """
    steady = steady_state_filter(config, specimen, time_step)
    kalman = kalman_filter_class()(dim_x=2 * specimen.stories, dim_z=specimen.stories, dim_u=2)
    kalman.x = np.zeros(2 * specimen.stories)
    kalman.F, kalman.H, kalman.K, kalman.P = steady.transition, steady.measurement, steady.gain, steady.covariance
    kalman.Q, kalman.R = steady.process_noise, steady.measurement_noise
    return kalman, steady.input_matrix
