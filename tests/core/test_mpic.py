"""Model-predictive interface control in the loop: against the whole building and the assembled loop."""

from dataclasses import replace

import numpy as np
import pytest

from bmd_rths_core.analysis.reference import reference_response
from bmd_rths_core.compensators.mpic.control import MpicControl
from bmd_rths_core.compensators.mpic.design import design
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.build import make_interface_control, make_known
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.controlled import controlled_margin, loop_at_mass_ratio
from bmd_rths_core.stability.discrete import configured_mass_ratio
from bmd_rths_core.table.controller import TableCommand, TableMeasurement
from bmd_rths_core.table.models.sensors import noise_streams
from bmd_rths_core.table.models.simulated import SimulatedTable
from tests.core.mpic_parts import DT, exact, motion, quiet

# ---- the whole


def test_a_test_with_true_models_and_no_noise_is_the_building():
    config, ground = quiet(), motion()
    record = RthsLoop(config, ground).run()
    whole = config.specimen.building().stacked_on(config.numerical_substructure.building())
    reference = reference_response(whole, ground.acceleration, DT)
    size = np.sqrt(np.mean(reference**2, axis=0))
    np.testing.assert_array_less(np.std(record.desired_acceleration - reference[:, 0]), 1e-9 * size[0])
    for floor in (0, 1):
        error = record.floor_accelerations[:-1, floor] - reference[1:, 1 + floor]
        assert np.sqrt(np.mean(error**2)) < 0.02 * size[1 + floor]


def test_the_assembled_loop_is_the_loop_step_by_step():
    config, ground = exact(), motion()
    loop = closed_loop(config, displacement=True)
    record = RthsLoop(config, ground).run()
    main, drive = noise_streams(config.run.seed)
    noise = np.hstack((main.standard_normal((600, 4)), drive.standard_normal((600, 2))))
    ahead = np.append(ground.acceleration[loop.preview :], np.zeros(loop.preview))[:, None]
    simulation = LinearSimulation(loop.system, loop.start @ ground.acceleration[: loop.preview, None])
    outputs = dict(zip(loop.outputs, simulation.advance(ahead, noise)[0], strict=True))
    for name in ("desired_acceleration", "required_force", "command", "table_displacement", "corrected_force"):
        signal = getattr(record, name)
        np.testing.assert_allclose(outputs[name], signal, atol=1e-8 * np.abs(signal).max())
    np.testing.assert_allclose(outputs["acting_force"][:-1], record.required_force[1:], atol=1e-6)
    assert loop.spectral_radius < 1.0


def test_a_lost_measurement_is_bridged_and_another_step_is_no_news():
    control, ground = make_interface_control(exact()), np.array([0.1, 0.2, 0.1, 0.0])
    measured = TableMeasurement(0, 0.5, 1e-3, 0.3, 0.0, 40.0, np.array([0.1, 0.2]))

    def second(*news):
        control.reset()
        control.step(ground)
        for entry in news:
            control.learn(entry)
        return control.step(ground)

    bridged = second()
    assert second(measured) != bridged
    assert second(measured._replace(step=5)) == bridged
    lost = measured._replace(floor_accelerations=np.array([np.nan, 0.2]), applied_command=np.nan)
    assert second(lost) == bridged


def test_a_command_that_was_not_applied_is_known():
    """The table held another command: a control that is told so goes on as if it had asked for that one."""
    config = quiet()
    control, ground = make_interface_control(config), np.zeros(4)
    table = SimulatedTable(config.simulated_table, config.specimen.building(), DT, 0)
    commands = []
    for k in range(400):
        commands.append(control.step(ground).command)
        applied = 0.5 if k == 100 else commands[-1]
        control.learn(table.exchange(TableCommand(k, applied)))
    assert max(map(abs, commands[:101])) == 0.0
    assert np.abs(table.motion.acceleration) < 1e-3
    predicted = control._state[control._layout.plant][-2]  # displacement as predicted, next to the true one
    assert predicted == pytest.approx(table.motion.displacement, rel=0.05, abs=1e-6)


def test_step_allocates_a_result_and_nothing_else_changes_the_packed_matrices():
    packed = design(make_known(exact()))
    control = MpicControl(packed, 2, load_cell=True)
    before = packed.measured.copy()
    for _ in range(10):
        control.step(np.ones(4))
    assert (packed.measured == before).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"identified_model__table": "none"},
            "identified_model.table: none; scheme mpic requires a model of the table",
        ),
        ({"nonlinear__integration": "cr"}, "nonlinear.integration: scheme mpic requires 'exact'"),
        (
            {"identified_model__stiffnesses": [1e6], "identified_model__damping_coefficients": [1.0]},
            "identified_model.stiffnesses: 1 entries; the specimen has 2",
        ),
    ],
)
def test_refusals(changes, message):
    with pytest.raises(InputError, match=message):
        make_interface_control(exact(**changes))


def test_the_hybrid_test_follows_a_specimen_that_is_not_its_model():
    """Capture: without noise, a stiffness changed by 1 % changes the result as it changes the building."""
    ground, config = motion(2000), quiet()
    changed = config.changed(simulated_table__specimen_stiffness_factor=1.01)
    runs = [RthsLoop(entry, ground).run() for entry in (config, changed)]
    lower = config.numerical_substructure.building()
    true = [entry.simulated_table.specimen(entry.specimen.building()).stacked_on(lower) for entry in (config, changed)]
    first, second = (reference_response(building, ground.acceleration, DT) for building in true)
    by_truth, by_test = second - first, runs[1].desired_acceleration - runs[0].desired_acceleration
    assert by_test @ by_truth[:, 0] / (by_truth[:, 0] @ by_truth[:, 0]) > 0.9
    at_top = runs[1].floor_accelerations[:-1, 1] - runs[0].floor_accelerations[:-1, 1]
    assert at_top @ by_truth[1:, 2] / (by_truth[1:, 2] @ by_truth[1:, 2]) > 0.95


def test_noise_of_the_displacement_does_not_change_what_does_not_read_it():
    ground = motion()
    loud = Config()
    silent = loud.changed(simulated_table__displacement_noise=0.0, simulated_table__force_noise=0.0)
    first, second = (RthsLoop(config, ground).run() for config in (loud, silent))
    for name in ("command", "desired_acceleration", "base_shear", "floor_accelerations", "corrected_force"):
        assert (getattr(first, name) == getattr(second, name)).all()
    added = first.table_displacement - second.table_displacement
    assert np.std(added) == pytest.approx(5e-5, rel=0.1)
    assert np.std(first.actuator_force - second.actuator_force) == pytest.approx(20.0, rel=0.1)


def test_seed_of_both_streams_is_that_of_the_run():
    ground, config = motion(50), exact()
    same = RthsLoop(config, ground).run().same_signals(RthsLoop(config, ground).run())
    other = RthsLoop(replace(config, run=replace(config.run, seed=1)), ground).run()
    assert same
    assert not other.same_signals(RthsLoop(config, ground).run())


# ---- stability


def heavier(config, factor):
    """Return a loop whose real specimen is heavier, step by step: the control keeps its model."""
    specimen = config.specimen.building()
    real = replace(specimen, masses=tuple(factor * mass for mass in specimen.masses))
    return SimulatedTable(config.simulated_table, real, config.run.time_step, config.run.seed)


def test_loop_with_a_heavier_specimen_is_that_of_a_table_that_carries_one():
    config, ground = quiet(), motion()
    configured = configured_mass_ratio(config)
    quotient = 1.2 * configured / (1.0 - configured)
    loop = loop_at_mass_ratio(config, configured, quotient / (1.0 + quotient))
    record = RthsLoop(config, ground, table=heavier(config, 1.2)).run()
    ahead = np.append(ground.acceleration[loop.preview :], np.zeros(loop.preview))[:, None]
    simulation = LinearSimulation(loop.system, loop.start @ ground.acceleration[: loop.preview, None])
    outputs = dict(zip(loop.outputs, simulation.advance(ahead, np.zeros((600, 6)))[0], strict=True))
    for name in ("desired_acceleration", "command", "table_displacement"):
        signal = getattr(record, name)
        np.testing.assert_allclose(outputs[name], signal, atol=1e-8 * np.abs(signal).max())


def test_margin_is_where_the_eigenvalues_leave_the_unit_circle():
    config = exact(
        mpic__model_error=5.0,
        identified_model__stiffnesses=[1.5e6, 3e6],
        identified_model__damping_coefficients=[3330.0, 78.0],
    )
    configured = configured_mass_ratio(config)
    margin = controlled_margin(config, configured)
    radius = loop_at_mass_ratio(config, configured, configured).spectral_radius
    assert bool(margin.stable_intervals) == (radius < 1.0)
    for interval in margin.stable_intervals:
        for end, frequency in ((interval.lower, interval.lower_frequency), (interval.upper, interval.upper_frequency)):
            if np.isfinite(frequency):
                assert loop_at_mass_ratio(config, configured, end).spectral_radius == pytest.approx(1.0, abs=1e-6)
            else:
                assert loop_at_mass_ratio(config, configured, end).spectral_radius < 1.0
