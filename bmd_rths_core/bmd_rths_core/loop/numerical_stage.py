"""What the conductor drives: the numerical substructure, with or without an interface control."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.table.controller import TableMeasurement


class Response(Protocol):
    """What the numerical substructure answers to a step."""

    @property
    def desired_acceleration(self) -> float:
        """Absolute interface acceleration [m/s²]."""

    @property
    def required_force(self) -> float:
        """Required interface force [N]."""

    @property
    def command(self) -> float:
        """What the command shaper gets [m/s²]: the desired acceleration, or what an interface control commands."""


class NumericalStage(Protocol):
    """The numerical substructure as the conductor drives it."""

    @property
    def takes_feedback(self) -> bool:
        """True when the shear fed back acts on it; an interface control knows better, and needs the measurement."""

    @property
    def displacements(self) -> NDArray[np.float64]:
        """Floor displacements relative to the ground, shape (n,) [m]."""

    def reset(self) -> None:
        """Return to rest before step 0."""

    def step(self, ground_acceleration: float, feedback_force: float) -> Response:
        """Advance to the next step, with the shear fed back [N] and the ground acceleration of this step [m/s²].

        Parameters
        ----------
        ground_acceleration : float
            Of this step [m/s²].
        feedback_force : float
            Shear fed back at the step before [N].
        """

    def learn(self, measurement: TableMeasurement) -> None:
        """Take in what the sensors said at the end of a step.

        Parameters
        ----------
        measurement : TableMeasurement
            Of that step.
        """
