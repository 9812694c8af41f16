"""The loop as one linear system: the matrices of all its stages, closed.

Nothing is idealised: the first-order hold of both loads, the command shaper, the zero-order hold and the fractional
delay of the table, the estimator, the force correction and the step between shear and feedback are the matrices of the
stages themselves (their ``state_space()``). What it cannot have is left to `RthsLoop`: limits, quantisation, stories
that yield.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.loop.build import make_command_shaper, make_force_correction, make_numerical_substructure
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructure
from bmd_rths_core.stages.shear_estimator import estimator_state_space
from bmd_rths_core.table.models.simulated import SimulatedTable

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedLoop:
    """The assembled loop, x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k].

    Parameters
    ----------
    system : DiscreteStateSpace
        The first state is the shear fed back. Inputs are the ground acceleration [m/s²] and the noise of the sensors,
        in parts of its root mean square, in the order of `Sensors`: table, floors, load cells.
    start : ndarray, shape (n,)
        State before step 0, per ground acceleration of step 0. Zero for an explicit integration, whose first ground
        acceleration should be 0.
    outputs : tuple of str
        Names of the outputs, those of `RunRecord`; floors are ``floor_1`` and so on. ``displacement_1`` and so on are
        those of the numerical substructure.
    """

    system: DiscreteStateSpace
    start: FloatArray
    outputs: tuple[str, ...]

    @property
    def spectral_radius(self) -> float:
        """Largest modulus of the eigenvalues; the loop is stable below 1."""
        return float(np.abs(np.linalg.eigvals(self.system.a)).max())


def closed_loop(config: Config, displacement: bool = False) -> ClosedLoop:
    """Assemble the loop of a configuration, with the simulated table.

    Parameters
    ----------
    config : Config
        The whole configuration; limits do not matter here.
    displacement : bool
        With table displacement and actuator force. The table displacement is a double integral: it takes no part in the
        loop, but has eigenvalues of 1.

    Returns
    -------
    ClosedLoop

    Notes
    -----
    Whatever controller is configured, its table is the simulated one, which for a real table is its identified model. A
    yielding numerical substructure is taken as linear about rest, with its own integration.
    """
    specimen, step = config.specimen.building(), config.run.time_step
    table = SimulatedTable(config.simulated_table, specimen, step, config.run.seed)
    numerical = make_numerical_substructure(config)
    stages = {
        "numerical": numerical.state_space(),
        "shaper": make_command_shaper(config).state_space(),
        "table": table.state_space(displacement),
        "estimator": estimator_state_space(config.shear_estimator, specimen, step),
        "correction": make_force_correction(config).state_space(),
    }
    # A signal is a row: what it takes of the state of the loop and of the inputs. The first state is the shear fed
    # back, the others are those of the stages.
    noisy = specimen.stories + 2
    size = 1 + sum(len(stage.a) for stage in stages.values())
    rows = np.eye(size + 1 + noisy)
    feedback, ground = rows[:1], rows[size : size + 1]
    noise = np.append(np.full(noisy - 1, config.simulated_table.acceleration_noise), config.simulated_table.shear_noise)
    own, begin = {}, 1
    for name, stage in stages.items():
        own[name] = rows[begin : begin + len(stage.a)]
        begin += len(stage.a)
    following: dict[str, FloatArray] = {}

    def run(name: str, *inputs: FloatArray) -> FloatArray:
        stage: DiscreteStateSpace = stages[name]
        signals = np.vstack(inputs)
        following[name] = stage.a @ own[name] + stage.b @ signals
        return stage.c @ own[name] + stage.d @ signals

    response = run("numerical", ground, feedback)
    command = run("shaper", response[:1])
    sensors = run("table", command)
    sensors[:noisy] += noise[:, None] * rows[size + 1 :]
    shear = run("estimator", sensors[:noisy])
    corrected = run("correction", response[1:2], shear)
    transition = np.vstack((corrected, *(following[name] for name in stages)))
    output = np.vstack((response[:2], command, sensors, shear, corrected, response[2:]))
    start = np.zeros(size)
    if isinstance(numerical, NumericalSubstructure):
        start[1 : 1 + len(stages["numerical"].a)] = numerical.start
    return ClosedLoop(
        system=DiscreteStateSpace(transition[:, :size], transition[:, size:], output[:, :size], output[:, size:]),
        start=start,
        outputs=(
            *("desired_acceleration", "required_force", "command", "table_acceleration"),
            *(f"floor_{i + 1}" for i in range(specimen.stories)),
            "base_shear",
            *(("table_displacement", "actuator_force") if displacement else ()),
            *("interface_force", "corrected_force"),
            *(f"displacement_{i + 1}" for i in range(len(config.numerical_substructure.masses))),
        ),
    )
