"""A specimen that softens or yields on the simulated table, and the building it is compared with."""

from dataclasses import replace

import numpy as np
import pytest

from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.analysis.reference import nonlinear_reference_response
from bmd_rths_core.analysis.true_building import simulated_references_of, true_references_of
from bmd_rths_core.campaign.engine import is_linear
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.build import make_virtual_controller
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.structure.nonlinear_building import nonlinear_building
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.models.damage import story_forces
from bmd_rths_core.table.models.simulated import SimulatedTable
from tests.core.mpic_parts import DT, exact, motion, quiet

SPECIMEN = ShearBuilding((760.0, 800.0), (2.5e6, 4.9e6), (3330.0, 78.0))
SECTIONS = (1.0, 1.2, 3000.0, 1.0, 1.1, 2900.0, 0.0, 0.0, 60.0, 0.0, 1.0, 60.0)
TABLES = [{}, {"unmodelled_mode": 0.2}, {"dynamics": "sections", "sections": SECTIONS}]


def table_of(**changes):
    return quiet(**{f"simulated_table__{name}": value for name, value in changes.items()}).simulated_table


@pytest.mark.parametrize("changes", TABLES)
def test_force_of_a_story_enters_the_plant_as_its_stiffness_does(changes):
    """With the force −Δk δ of a stiffer story as an input the plant is that of the stiffer specimen."""
    plant = table_of(**changes).plant
    forces, own = story_forces(plant, SPECIMEN), plant(SPECIMEN)
    stiffer = plant(replace(SPECIMEN, stiffnesses=(2.9e6, 4.1e6)))
    lacking = -np.diag([0.4e6, -0.8e6]) @ forces.drift
    np.testing.assert_allclose(own.a + forces.state @ lacking, stiffer.a, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(own.output + forces.output @ lacking, stiffer.output, rtol=1e-9, atol=1e-6)


def driven(table, commands):
    simulated = SimulatedTable(table, SPECIMEN, DT, 0)
    return np.array([simulated.exchange(TableCommand(k, command))[1:] for k, command in enumerate(commands)], object)


@pytest.mark.parametrize("changes", [*TABLES, {"command_delay": 0.0017}])
def test_stories_that_never_yield_are_linear(changes):
    commands = np.random.default_rng(2).standard_normal(60)
    linear, wide = (driven(table_of(**changes, **own), commands) for own in ({}, {"yield_drifts": (1.0, 1.0)}))
    for one, other in zip(linear.T, wide.T, strict=True):
        np.testing.assert_allclose(np.vstack(one), np.vstack(other), rtol=1e-7, atol=1e-8)


@pytest.mark.slow
def test_yielding_specimen_on_a_perfect_table_is_the_building_on_the_ground():
    """A ground that goes from one value to another at once is what the held command is."""
    table = table_of(dynamics="perfect", yield_drifts=(4e-4, 2e-4), specimen_stiffness_factor=1.1)
    commands = np.repeat(3.0 * np.random.default_rng(4).standard_normal(6), 20)
    floors = np.array([row[-1] for row in driven(table, commands)], dtype=float)
    real = table.specimen(SPECIMEN)
    own = nonlinear_building(real, replace(Config().nonlinear, **yielding(table)))
    fine = np.repeat(commands, 40)
    response = nonlinear_reference_response(own, fine, DT / 40)
    assert rmse_percent(response[39::40, -1], floors[:, -1]) < 1.0
    linear = np.array([row[-1] for row in driven(replace(table, yield_drifts=()), commands)], dtype=float)
    assert rmse_percent(response[39::40, -1], linear[:, -1]) > 20.0


def yielding(table):
    return {
        "story_model": "bilinear",
        "yield_drifts": table.yield_drifts,
        "post_yield_ratio": table.post_yield_ratio,
        "integration": "cr",
    }


DAMAGED = [{"softening_factor": 0.8, "softening_time": 1.0}, {"yield_drifts": (4e-5, 2e-5)}]


@pytest.mark.slow
@pytest.mark.parametrize("changes", DAMAGED, ids=["softens", "yields"])
def test_hybrid_test_on_a_perfect_table_is_that_of_the_damaged_building(changes):
    perfect = {"run__scheme": "uc", "run__time_step": 0.001, "simulated_table__dynamics": "perfect"}
    config = quiet().changed(**perfect)
    damaged = config.changed(**{f"simulated_table__{name}": value for name, value in changes.items()})
    coarse = motion(500).acceleration
    ground = np.interp(np.arange(2500) * 0.001, np.arange(500) * DT, coarse)
    record = RthsLoop(damaged, GroundMotion("fine", 0.001, ground, "made here", "0" * 64)).run()
    intact = simulated_references_of([ground], config)
    (reference,) = true_references_of([ground], damaged, intact)
    assert rmse_percent(reference[1:, -1], record.floor_accelerations[:-1, -1]) < 4.0
    assert rmse_percent(intact[0][1:, -1], record.floor_accelerations[:-1, -1]) > 15.0
    assert not is_linear(damaged)
    assert is_linear(config)


def test_reference_that_does_not_change_is_the_reference():
    ground = motion(500).acceleration
    config = exact()
    soft = config.changed(simulated_table__softening_factor=0.8, simulated_table__softening_time=100.0)
    (expected,), (found,) = (simulated_references_of([ground], own) for own in (config, soft))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_softening_begins_at_its_step_and_a_reset_repairs():
    config = exact(simulated_table__softening_factor=0.8, simulated_table__softening_time=0.25)
    table = SimulatedTable(config.simulated_table, SPECIMEN, DT, 0)
    intact = SimulatedTable(exact().simulated_table, SPECIMEN, DT, 0)
    commands = np.sin(0.2 * np.arange(60))
    first, same = ([t.exchange(TableCommand(k, a)) for k, a in enumerate(commands)] for t in (table, intact))
    shears = [[measured.base_shear for measured in run] for run in (first, same)]
    differs = np.flatnonzero(np.array(shears[0]) != np.array(shears[1]))
    assert differs[0] == 50
    table.connect()
    again = [table.exchange(TableCommand(k, a)) for k, a in enumerate(commands)]
    assert [measured.base_shear for measured in again] == shears[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"simulated_table__softening_factor": 0.8, "simulated_table__yield_drifts": (1e-3, 1e-3)}, "only one of them"),
        (
            {
                "simulated_table__softening_factor": 0.8,
                "nonlinear__story_model": "bilinear",
                "nonlinear__yield_drifts": (1e-3,),
                "nonlinear__integration": "cr",
            },
            "softening_factor: a specimen that softens over",
        ),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(InputError, match=message):
        exact(**changes)


def test_refusals_of_table_and_virtual_controller():
    config = exact(simulated_table__yield_drifts=(1e-3,))
    with pytest.raises(InputError, match="yield_drifts: 1 entries; the specimen has 2"):
        RthsLoop(config, GroundMotion("m", DT, np.zeros(10), "made here", "0" * 64))
    with pytest.raises(InputError, match="not available on a virtual controller"):
        make_virtual_controller(config, Faults())
