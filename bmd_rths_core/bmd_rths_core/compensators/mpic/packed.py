"""A step of MPIC as one matrix: observer, virtual building and tracking, multiplied out once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.mpic.estimation import Observer
from bmd_rths_core.compensators.mpic.specimen_observer import SpecimenObserver
from bmd_rths_core.compensators.mpic.tracking import Tracking
from bmd_rths_core.compensators.mpic.virtual_building import VirtualBuilding
from bmd_rths_core.table.models.held_plant import HeldPlant

FloatArray = NDArray[np.float64]


class Layout(NamedTuple):
    """Which rows of the stacked vector are what: the state before the step, then its inputs.

    Parameters
    ----------
    plant : slice
        x̂⁻, the plant as predicted.
    building : slice
        Φ x_b + Γ₀ a_g of the step before.
    specimen : slice
        What the own observer of the virtual building predicts: x̂⁻ of another joint observer, or Φ x̂ + Γ₀ a_t of the
        step before of the specimen's; empty without one.
    ground : slice
        Displacement and velocity of the ground, but for what a_g of this step adds.
    ground_acceleration : slice
        Input: a_g of this step and of those that are known in advance.
    measured : slice
        Input: what the sensors said at the end of the step before.
    command_error : slice
        Input: command that was applied in the step before, less the one that was asked for.
    """

    plant: slice
    building: slice
    specimen: slice
    ground: slice
    ground_acceleration: slice
    measured: slice
    command_error: slice

    @property
    def states(self) -> int:
        """Number of states."""
        return int(self.ground.stop)

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self.command_error.stop) - self.states


class PackedStep(NamedTuple):
    """[outputs, next state] = M [state, inputs]; outputs are a_N, f, u and the numerical displacements.

    Parameters
    ----------
    layout : Layout
    outputs : int
        Number of outputs.
    measured : ndarray, shape (outputs + states, states + inputs)
        M of a step whose measurement has come.
    bridged : ndarray
        M of a step without one: the models alone go on.
    start : ndarray, shape (states,)
        State at rest at step 0 per ground acceleration of step 0: no interval before it has acted.
    """

    layout: Layout
    outputs: int
    measured: FloatArray
    bridged: FloatArray
    start: FloatArray


def packed_step(
    plant: HeldPlant,
    building: VirtualBuilding,
    observer: Observer,
    tracking: Tracking,
    time_step: float,
    specimen: SpecimenObserver | Observer | None = None,
) -> PackedStep:
    """Multiply out a step.

    Parameters
    ----------
    plant, building, observer, tracking
        The parts.
    time_step : float
        Δt [s].
    specimen : SpecimenObserver or Observer, optional
        Corrects the virtual building in place of `observer`, which then only drives the table.

    Returns
    -------
    PackedStep
    """
    own = 0
    if isinstance(specimen, Observer):
        own = len(plant.transition)
    elif specimen is not None:
        own = len(specimen.transition)
    sizes = (
        len(plant.transition),
        len(building.force),
        own,
        2,
        len(tracking.preview) + 1,
        len(observer.measurement),
        1,
    )
    ends = np.cumsum(sizes).tolist()
    layout = Layout(*(slice(end - size, end) for end, size in zip(ends, sizes, strict=True)))
    start = np.zeros(layout.states)
    start[layout.building] = -building.ground_now[:, 0]
    start[layout.ground] = -_ground_now(time_step)[:, 0]
    measured, bridged = (
        _multiplied_out(layout, plant, building, observer, tracking, time_step, specimen, gain) for gain in (1.0, 0.0)
    )
    return PackedStep(layout, 3 + building.numerical_stories, measured, bridged, start)


def _multiplied_out(
    layout: Layout,
    plant: HeldPlant,
    building: VirtualBuilding,
    observer: Observer,
    tracking: Tracking,
    time_step: float,
    specimen: SpecimenObserver | Observer | None,
    gain: float,
) -> FloatArray:
    """Return M; a signal is a row, what it takes of the state and of the inputs."""
    rows = np.eye(layout.states + layout.inputs)
    ground = rows[layout.ground_acceleration]
    predicted = rows[layout.plant] + plant.command @ rows[layout.command_error]
    innovation = gain * (rows[layout.measured] - observer.measurement @ predicted)
    estimate = predicted + observer.plant_gain @ innovation
    virtual = rows[layout.building] + building.ground_now @ ground[:1]
    following = rows[layout.specimen]
    own: FloatArray | None = None
    if specimen is None:
        virtual = virtual + observer.building_gain @ innovation
    elif isinstance(specimen, Observer):
        expected = rows[layout.specimen] + plant.command @ rows[layout.command_error]
        told = gain * (rows[layout.measured] - specimen.measurement @ expected)
        virtual = virtual + specimen.building_gain @ told
        own = expected + specimen.plant_gain @ told
    else:
        # Without a measurement the motion of the table is what the joint observer makes of the command.
        moving = rows[layout.measured][:1] if gain else plant.output[:1] @ estimate
        modelled = rows[layout.specimen] + specimen.now @ moving
        told = gain * (rows[layout.measured][list(specimen.sensors)] - specimen.measurement @ modelled)
        virtual = virtual + specimen.building_gain @ told
        following = specimen.transition @ (modelled + specimen.gain @ told) + specimen.before @ moving
    moved = rows[layout.ground] + _ground_now(time_step) @ ground[:1]
    error = estimate.copy()
    error[plant.displacement : plant.displacement + 2] -= virtual[list(building.interface)] + moved
    command = -tracking.gain @ np.vstack((error, virtual, ground[:1])) - tracking.preview @ ground[1:]
    if own is not None:
        following = plant.transition @ own + plant.command @ command[None]
    outputs = np.vstack((building.acceleration @ virtual, building.force @ virtual, command))
    return np.vstack(
        (
            outputs,
            virtual[: building.numerical_stories],
            plant.transition @ estimate + plant.command @ command[None],
            building.transition @ virtual + building.ground_before @ ground[:1],
            following,
            np.array([[1.0, time_step], [0.0, 1.0]]) @ moved + _ground_before(time_step) @ ground[:1],
        )
    )


def _ground_before(time_step: float) -> FloatArray:
    """Return what a_g at the beginning of a step adds to displacement and velocity of the ground at its end."""
    return np.array([[time_step**2 / 3.0], [time_step / 2.0]])


def _ground_now(time_step: float) -> FloatArray:
    """Return the same of a_g at the end of the step."""
    return np.array([[time_step**2 / 6.0], [time_step / 2.0]])
