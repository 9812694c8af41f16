"""What a compensator is: the parts of the loop that it makes, and what it may know.

A compensator sees noisy sensors, the ground motion and models that were identified, never the truth of the plant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.table.models.plant import Plant

FloatArray = NDArray[np.float64]


class Shaper(Protocol):
    """Turn the desired acceleration into the command of the table; the rest of the chain stays as it is.

    Called as `step`, then `learn` with the measurement of that step where there is one. Reads no clock, logs nothing.
    """

    def reset(self) -> None:
        """Return to rest before step 0."""

    def step(self, desired_acceleration: float) -> float:
        """Return the command of this step.

        Parameters
        ----------
        desired_acceleration : float
            Absolute acceleration of the interface [m/s²].

        Returns
        -------
        float
            Acceleration command of the table [m/s²].
        """

    def learn(self, measurement: TableMeasurement) -> None:
        """Take in what the sensors said at the end of a step; a step whose measurement is lost has no call.

        Parameters
        ----------
        measurement : TableMeasurement
            Of that step.
        """

    def state_space(self) -> DiscreteStateSpace | None:
        """Return the shaper as a linear system, or None where it is not linear.

        Returns
        -------
        DiscreteStateSpace or None
            Input desired acceleration [m/s²], and where the shaper learns, the accelerations of table and n floors
            [m/s²], base shear [N], displacement [m] and actuator force [N] at the end of the step before. Output
            command [m/s²]. Numerical substructure and feedback scale must not matter: stability varies them.
        """


class AdaptiveShaper(Shaper, Protocol):
    """A shaper that is not linear because it adapts."""

    @property
    def adapted(self) -> Mapping[str, float]:
        """What is adapted, as it is in this step, by name; the same names always."""

    def held(self) -> DiscreteStateSpace:
        """Return the shaper as it begins, its adaptation held, as `Shaper.state_space` has it; stability needs it."""


class InterfaceDemand(NamedTuple):
    """What an interface control asks for in a step.

    Parameters
    ----------
    desired_acceleration : float
        Absolute acceleration of the interface [m/s²].
    required_force : float
        The interface shear that acts on the numerical substructure [N].
    command : float
        Acceleration command of the table [m/s²].
    """

    desired_acceleration: float
    required_force: float
    command: float


class LinearControl(NamedTuple):
    """An interface control as a linear system, every step measured and every command applied as asked for.

    Parameters
    ----------
    system : DiscreteStateSpace
        Inputs preview + 1 ground accelerations, this step's first, then the sensors at the end of the step before in
        the order of `Shaper.state_space`. Outputs desired acceleration, required force, command and the displacements
        of the numerical floors.
    start : ndarray, shape (m,)
        State at rest at step 0, per ground acceleration of step 0 in m/s².
    integrators : tuple of int
        States that integrate the ground motion alone, and so are not stable.
    """

    system: DiscreteStateSpace
    start: FloatArray
    integrators: tuple[int, ...]


class InterfaceControl(Protocol):
    """Own the numerical substructure and the command; takes the place of both stages.

    Called as `step`, then `learn` with the measurement of that step where there is one. A step without measurement
    is bridged by the models. Reads no clock, logs nothing.

    Attributes
    ----------
    preview : int
        Steps of the ground motion that have to be known in advance; the motion of the table starts so much later.
    displacements : ndarray, shape (n,)
        Of the numerical floors relative to the ground, at the last step [m].
    """

    preview: int
    displacements: FloatArray

    def reset(self) -> None:
        """Return to rest before step 0."""

    def step(self, ground_acceleration: FloatArray) -> InterfaceDemand:
        """Return desired acceleration, required force and command of this step.

        Parameters
        ----------
        ground_acceleration : ndarray, shape (preview + 1,)
            a_g of this step and of those after it [m/s²]; zero after the end of the motion.
        """

    def learn(self, measurement: TableMeasurement) -> None:
        """Take in what the sensors said at the end of a step; a step whose measurement is lost has no call.

        Parameters
        ----------
        measurement : TableMeasurement
            Of that step.
        """

    def state_space(self) -> LinearControl | None:
        """Return the control as a linear system, or None where it is not linear."""


class AdaptiveControl(InterfaceControl, Protocol):
    """An interface control that is not linear because it adapts."""

    @property
    def adapted(self) -> Mapping[str, float]:
        """What is adapted, as it is in this step, by name; the same names always."""

    def held(self) -> LinearControl:
        """Return the control as it begins, its adaptation held; stability needs it."""


@dataclass(frozen=True)
class Known:
    """What a compensator may know of a test.

    Parameters
    ----------
    time_step : float
        Δt [s].
    numerical : LinearBuilding
        The numerical substructure.
    linear : bool
        The numerical substructure is linear and integrated exactly.
    specimen : LinearBuilding
        Model of the specimen: the identified one where there is one.
    table : Plant or None
        Identified model of the table with the specimen on it; None when there is none.
    command_delay : float
        Pure delay of that model [s].
    feedback_scale : float
        Share of the shear that acts on the numerical substructure.
    load_cell : bool
        The interface shear is measured by load cells.
    noise : SensorNoise
        Measured or assumed noise of the sensors, root mean square.
    settings : object
        The section of the compensator.
    """

    time_step: float
    numerical: LinearBuilding
    linear: bool
    specimen: LinearBuilding
    table: Plant | None
    command_delay: float
    feedback_scale: float
    load_cell: bool
    noise: SensorNoise
    settings: Any


class SensorNoise(NamedTuple):
    """Noise of the sensors, root mean square.

    Parameters
    ----------
    acceleration : float
        Of every accelerometer [m/s²].
    displacement : float
        Of the table's displacement [m].
    shear : float
        Of the load cells [N].
    """

    acceleration: float
    displacement: float
    shear: float


@dataclass(frozen=True)
class Compensator:
    """A way to compensate for the table, found by its name.

    Parameters
    ----------
    name : str
        Of configuration and command line.
    summary : str
        What it does, in one sentence.
    needs : str
        What it has to know, and where it refuses to start.
    shaper : callable, optional
        Makes the `Shaper`; the numerical substructure, the shear estimator and the force correction stay as they are.
    control : callable, optional
        Makes the `InterfaceControl`, in place of numerical substructure and shaper. One of the two is required.
    force_correction : bool
        The unbalanced force is corrected; only with a shaper.
    learns : bool
        The shaper takes in measurements. Without it the command shaper gets none on the ROS graph.
    settings : type, optional
        Frozen dataclass of its parameters, a section of the configuration as `parameters` has it.
    """

    name: str
    summary: str
    needs: str
    shaper: Callable[[Known], Shaper] | None = None
    control: Callable[[Known], InterfaceControl] | None = None
    force_correction: bool = False
    learns: bool = True
    settings: type | None = None
