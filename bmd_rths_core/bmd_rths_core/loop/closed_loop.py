"""The loop as one linear system: the matrices of all its stages, closed.

Nothing is idealised: the first-order hold of both loads, the command shaper, the zero-order hold and the fractional
delay of the table, the estimator, the force correction and the step between shear and feedback are the matrices of the
stages themselves (their ``state_space()``). What it cannot have is left to `RthsLoop`: limits, quantisation, stories
that yield.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.integration.substeps import periodic_state_space
from bmd_rths_core.loop.build import (
    make_calibration,
    make_command_shaper,
    make_force_correction,
    make_interface_control,
    make_numerical_substructure,
)
from bmd_rths_core.loop.controlled_loop import controlled_loop
from bmd_rths_core.loop.linear_loop import ClosedLoop, output_names, sensor_noise
from bmd_rths_core.stages.nonlinear_substructure import NonlinearSubstructure
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructure
from bmd_rths_core.stages.shear_estimator import estimator_state_space
from bmd_rths_core.table.models.simulated import SimulatedTable

FloatArray = NDArray[np.float64]


def has_matrices(config: Config) -> bool:
    """Tell whether the loop of a configuration can be assembled, as one linear system from step to step.

    Its compensator has to be linear, and its numerical substructure without sub-steps, with which no step is like the
    next.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    if config.numerical_substructure.substeps > 1:
        return False
    if not make_calibration(config).is_identity:  # the matrices know no sensor that is told otherwise
        return False
    part = make_interface_control(config) or make_command_shaper(config)
    return part.state_space() is not None


def closed_loop(config: Config, displacement: bool = False) -> ClosedLoop:
    """Assemble the loop of a configuration, with the simulated table.

    Parameters
    ----------
    config : Config
        The whole configuration; limits do not matter here.
    displacement : bool
        With table displacement and actuator force. The table displacement is a double integral: in the loop of a shaper
        it takes no part, but has eigenvalues of 1. The loop of an interface control always has it.

    Returns
    -------
    ClosedLoop
        Of a shaper: the first state is the shear fed back. With sub-steps it goes from target to target.

    Notes
    -----
    Whatever controller is configured, its table is the simulated one, which for a real table is its identified model. A
    yielding numerical substructure is taken as linear about rest, with its own integration. The adaptation of a shaper
    is held as it begins; `has_matrices` tells.

    Raises
    ------
    InputError
        The compensator is neither linear nor does it say what it is without adaptation.
    """
    if config.compensator.control is not None:
        return controlled_loop(config)
    if config.numerical_substructure.substeps > 1:
        return _from_target_to_target(config, displacement)
    numerical = make_numerical_substructure(config)
    return _from_step_to_step(config, displacement, numerical.state_space(), _start(numerical), _linear(config))


def steps_of_a_period(config: Config, displacement: bool = False) -> list[ClosedLoop]:
    """Assemble the N different steps of a loop with sub-steps, in their order.

    Parameters
    ----------
    config, displacement
        As for `closed_loop`, with a compensator that shapes commands.

    Returns
    -------
    list of ClosedLoop
        All with the same state. The ground acceleration is that of the next target, and counts in the first step only.
    """
    numerical, substeps = make_numerical_substructure(config), config.numerical_substructure.substeps
    integration, mass = numerical.state_space(), config.elastic_substructure().interface_mass
    # Of the targets the force that acts at once is taken away, and added in every step.
    direct = np.zeros((len(integration.c), 2))
    direct[:2, 1] = 1.0 / mass, 1.0
    targets = integration._replace(d=integration.d - direct)
    stages = periodic_state_space(targets, direct, substeps)
    start = np.zeros((len(stages[0].a), 1))
    states = len(integration.a)
    start[:states] = _start(numerical)
    start[states] = 1.0  # the ground acceleration at step 0
    shaper = _linear(config)
    return [_from_step_to_step(config, displacement, stage, start, shaper) for stage in stages]


def _from_target_to_target(config: Config, displacement: bool) -> ClosedLoop:
    """Return all steps of a period in one."""
    first, *others = steps_of_a_period(config, displacement)
    a, b, substeps = first.system.a, first.system.b, 1 + len(others)
    for other in others:
        a, b = other.system.a @ a, other.system.a @ b
    start = np.hstack((first.start, np.zeros((len(a), substeps - 1))))
    system = first.system._replace(a=a, b=b)
    return ClosedLoop(system, start, first.outputs, preview=substeps, table=first.table, substeps=substeps)


def _start(numerical: NumericalSubstructure | NonlinearSubstructure) -> FloatArray:
    """Return the state of the numerical substructure before step 0, per ground acceleration there."""
    if isinstance(numerical, NumericalSubstructure):
        return numerical.start[:, None]
    return np.zeros((len(numerical.state_space().a), 1))


def _from_step_to_step(
    config: Config,
    displacement: bool,
    integration: DiscreteStateSpace,
    begin: FloatArray,
    shaper: DiscreteStateSpace,
) -> ClosedLoop:
    specimen, step = config.specimen.building(), config.run.time_step
    table = SimulatedTable(config.simulated_table, specimen, step, config.run.seed)
    # What a shaper takes of the sensors at the end of the step before is a state of the loop, one each.
    taken = np.flatnonzero(shaper.b[:, 1:].any(axis=0) | shaper.d[:, 1:].any(axis=0))
    moving = displacement or (len(taken) > 0 and int(taken[-1]) >= specimen.stories + 2)
    stages = {
        "numerical": integration,
        "shaper": shaper._replace(b=shaper.b[:, (0, *(1 + taken))], d=shaper.d[:, (0, *(1 + taken))]),
        "table": table.state_space(moving),
        "estimator": estimator_state_space(config.shear_estimator, specimen, step),
        "correction": make_force_correction(config).state_space(),
    }
    # A signal is a row: what it takes of the state of the loop and of the inputs. The first state is the shear fed
    # back, the others are those of the stages.
    noise = sensor_noise(config.simulated_table, specimen.stories)[: specimen.stories + (4 if moving else 2)]
    noisy = len(noise)
    size = 1 + sum(len(stage.a) for stage in stages.values()) + len(taken)
    rows = np.eye(size + 1 + noisy)
    feedback, ground = rows[:1], rows[size : size + 1]
    places, first = {}, 1
    for name, stage in stages.items():
        places[name] = slice(first, first + len(stage.a))
        first += len(stage.a)
    following: dict[str, FloatArray] = {}

    def run(name: str, *inputs: FloatArray) -> FloatArray:
        stage: DiscreteStateSpace = stages[name]
        signals = np.vstack(inputs)
        own = rows[places[name]]
        following[name] = stage.a @ own + stage.b @ signals
        return stage.c @ own + stage.d @ signals

    response = run("numerical", ground, feedback)
    command = run("shaper", response[:1], rows[size - len(taken) : size])
    sensors = run("table", command)
    sensors += noise[:, None] * rows[size + 1 :]
    shear = run("estimator", sensors[: specimen.stories + 2])
    corrected = run("correction", response[1:2], shear)
    transition = np.vstack((corrected, *(following[name] for name in stages), sensors[taken]))
    output = np.vstack((response[:2], command, sensors, shear, corrected, corrected, response[2:]))
    start = np.zeros((size, 1))
    start[1 : 1 + len(begin)] = begin
    return ClosedLoop(
        system=DiscreteStateSpace(transition[:, :size], transition[:, size:], output[:, :size], output[:, size:]),
        start=start,
        outputs=output_names(config, moving),
        table=tuple(range(size)[places["table"]]),
    )


def _linear(config: Config) -> DiscreteStateSpace:
    """Return the command shaper of a configuration, or what it is without adaptation."""
    shaper = make_command_shaper(config)
    system = shaper.state_space()
    if system is None and hasattr(shaper, "held"):
        system = shaper.held()
    if system is None:
        raise InputError(f"run.scheme: {config.run.scheme} is not linear; there are no matrices of its loop")
    return system
