"""Adaptation of MPIC to the stiffness of the stories: design again while the test runs, a piece a step."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.mpic.control import MpicControl
from bmd_rths_core.compensators.mpic.design import design_in_pieces
from bmd_rths_core.compensators.mpic.packed import PackedStep
from bmd_rths_core.compensators.mpic.riccati import Pieces, by_doubling
from bmd_rths_core.compensators.mpic.stiffness import StoryStiffness
from bmd_rths_core.compensators.protocol import InterfaceDemand, Known, LinearControl
from bmd_rths_core.errors import InputError
from bmd_rths_core.structure.shear_building import ShearBuilding, chain_of
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.table.models.plant import Plant

FloatArray = NDArray[np.float64]

#: MPIC is designed again for a specimen that differs by so much from the one it was designed for.
_DIFFERS = 0.01


class StiffnessControl:
    """MPIC for the specimen as `StoryStiffness` finds it.

    Parameters
    ----------
    control : MpicControl
        With the identified specimen.
    known : Known
        What it was designed from.
    stiffness : StoryStiffness
        The adaptation.

    Attributes
    ----------
    preview, displacements
        See `InterfaceControl`.

    Notes
    -----
    A design takes some thirty pieces, one with every measurement, between which the earlier design goes on: what a test
    does depends on its measurements alone, and not on how fast the computer is.
    """

    def __init__(self, control: MpicControl, known: Known, stiffness: StoryStiffness) -> None:
        self._control, self._known, self._stiffness = control, known, stiffness
        self._identified = control.packed
        self.preview, self.displacements = control.preview, control.displacements
        self.reset()

    @property
    def adapted(self) -> Mapping[str, float]:
        """Factors of the stiffness of the stories of this step [1], by name."""
        return {f"story_{j + 1}_stiffness": factor for j, factor in enumerate(self._stiffness.factors.tolist())}

    def reset(self) -> None:
        """Return to rest before step 0, with the identified specimen."""
        self._control.packed = self._identified
        self._control.reset()
        self._stiffness.reset()
        self._designed = np.ones(self._known.specimen.stories)
        self._work: Pieces[PackedStep] | None = None

    def step(self, ground_acceleration: FloatArray) -> InterfaceDemand:
        """Return what MPIC asks for."""
        return self._control.step(ground_acceleration)

    def learn(self, measurement: TableMeasurement) -> None:
        """Tell MPIC, adapt, and do a piece of the design."""
        if not self._control.expects(measurement):
            return
        self._control.learn(measurement)
        self._stiffness.learn(measurement)
        if self._work is None and np.abs(self._stiffness.factors - self._designed).max() > _DIFFERS:
            self._designed = self._stiffness.factors
            self._work = design_in_pieces(stiffened(self._known, self._designed), by_doubling)
        if self._work is not None:
            try:
                next(self._work)
            except StopIteration as end:
                self._control.packed, self._work = end.value, None
            except InputError:  # there is no such design: the test goes on with the one it has
                self._work = None

    def state_space(self) -> None:
        """Return None: a control that adapts is not linear."""

    def held(self) -> LinearControl:
        """Return the control with the identified specimen."""
        return self._control.state_space()


def stiffened(known: Known, factors: FloatArray) -> Known:
    """Return what is known with other story stiffnesses of the specimen.

    Parameters
    ----------
    known : Known
        With an identified table.
    factors : ndarray, shape (n,)
        Stiffness of each story over the identified one.
    """
    specimen = chain_of(known.specimen, "mpic.stiffness")
    stiffnesses = tuple((factors * np.asarray(specimen.stiffnesses)).tolist())
    table = None if known.table is None else _stiffened_plant(known.table, factors)
    changed = ShearBuilding(specimen.masses, stiffnesses, specimen.damping_coefficients)
    return dataclasses.replace(known, specimen=changed, table=table)


def _stiffened_plant(plant: Plant, factors: FloatArray) -> Plant:
    """Return table and specimen with other stiffnesses: they stand in the columns of the displacements alone."""
    n = len(factors)
    floors = slice(len(plant.a) - 2 - 2 * n, len(plant.a) - 2 - n)
    # With a drift of one story alone, the floors above it displaced by 1, nothing but its stiffness acts.
    shapes, drifts = np.zeros((len(plant.a), n)), np.zeros((n, len(plant.a)))
    shapes[floors], drifts[:, floors] = np.tri(n), np.eye(n) - np.eye(n, k=-1)
    more = shapes @ np.diag(factors - 1.0) @ drifts
    return plant._replace(a=plant.a + plant.a @ more, output=plant.output + plant.output @ more)
