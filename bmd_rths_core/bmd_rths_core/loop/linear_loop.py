"""A loop as one linear system, whatever it is made of: its matrices, what comes out of them, and its stability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedLoop:
    """The assembled loop, x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k].

    Parameters
    ----------
    system : DiscreteStateSpace
        Inputs are the ground acceleration `preview` steps ahead [m/s²] and the noise of the sensors, in parts of its
        root mean square, in the order of `sensor_noise`.
    start : ndarray, shape (n, max(1, preview))
        State before step 0, per ground acceleration of the first steps. Zero for an explicit integration, whose first
        ground acceleration should be 0.
    outputs : tuple of str
        Names of the outputs, those of `RunRecord`; floors are ``floor_1`` and so on. ``displacement_1`` and so on are
        those of the numerical substructure.
    preview : int
        Steps that the ground acceleration is known in advance.
    table : tuple of int
        States of the simulated table, those of its `state_space`; empty where the loop has none.
    integrators : tuple of int
        States that integrate the ground motion alone: nothing of the loop enters them, and they are not stable.
    substeps : int
        Steps of the loop that one k stands for. Above 1 the system is that from one target of the numerical
        substructure to the next; its outputs and its noise are those of the step at which a target is due.
    """

    system: DiscreteStateSpace
    start: FloatArray
    outputs: tuple[str, ...]
    preview: int = 0
    table: tuple[int, ...] = ()
    integrators: tuple[int, ...] = ()
    substeps: int = 1

    @property
    def transition(self) -> FloatArray:
        """A of the loop alone, without the integrators of the ground motion."""
        return np.delete(np.delete(self.system.a, self.integrators, axis=0), self.integrators, axis=1)

    @property
    def spectral_radius(self) -> float:
        """Largest modulus of the eigenvalues, for one step of the loop; the loop is stable below 1."""
        return float(np.abs(np.linalg.eigvals(self.transition)).max() ** (1.0 / self.substeps))


def output_names(config: Config, displacement: bool) -> tuple[str, ...]:
    """Return the names of the outputs of a loop; the acting force is what acts on the numerical substructure next.

    Parameters
    ----------
    config : Config
        The whole configuration.
    displacement : bool
        With table displacement and actuator force.
    """
    return (
        *("desired_acceleration", "required_force", "command", "table_acceleration"),
        *(f"floor_{i + 1}" for i in range(len(config.specimen.masses))),
        "base_shear",
        *(("table_displacement", "actuator_force") if displacement else ()),
        *("interface_force", "corrected_force", "acting_force"),
        *(f"displacement_{i + 1}" for i in range(len(config.numerical_substructure.masses))),
    )


def sensor_noise(table: SimulatedTableConfig, floors: int) -> FloatArray:
    """Return the noise of the sensors, in the order of the sensors of a loop.

    Parameters
    ----------
    table : SimulatedTableConfig
        The table.
    floors : int
        Number of floors n.

    Returns
    -------
    ndarray, shape (4 + n,)
        Root mean square of table and floors [m/s²], load cells [N], displacement [m] and actuator force [N].
    """
    accelerations = np.full(floors + 1, table.acceleration_noise)
    return np.concatenate((accelerations, (table.shear_noise, table.displacement_noise, table.force_noise)))
