"""Variant R of MPIC: the observer against its covariance, the whole against the joint observer on a wrong table."""

import numpy as np
import pytest

from bmd_rths_core.analysis.reference import reference_response
from bmd_rths_core.compensators.mpic.specimen_observer import specimen_observer
from bmd_rths_core.config import Config
from bmd_rths_core.integration.discretisation import zero_order_hold
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.loop.build import make_interface_control
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.table.models.sensors import noise_streams
from tests.core.mpic_parts import DT, NOISE, SPECIMEN, exact, motion, parts, quiet

FLOORS = 0.2


def by_measured_table(make=exact, **changes):
    return make(mpic__observer="measured_table", **changes)


def by_uncertain_table(make=exact, **changes):
    return make(mpic__observer="uncertain_table", **changes)


@pytest.mark.slow
def test_observer_of_the_specimen_has_the_error_that_it_says():
    """20,000 steps of a specimen with just the errors that are assumed, on a table with a noisy accelerometer."""
    _, building = parts()
    found = specimen_observer(building, SPECIMEN, NOISE, True, FLOORS, DT)
    random, n = np.random.default_rng(0), SPECIMEN.stories
    acting = zero_order_hold(SPECIMEN.relative_motion()[0], np.eye(2 * n)[:, n:], DT)[1]
    true, virtual, predicted, modelled = (
        np.zeros(2 * n),
        np.zeros(len(building.force)),
        np.zeros(2 * n),
        np.zeros(len(building.force)),
    )
    deviations, errors = np.array([NOISE.acceleration] * n + [NOISE.shear]), []
    for _ in range(20_000):
        innovation = found.measurement @ (true - predicted) + deviations * random.standard_normal(n + 1)
        errors.append(building.acceleration @ (virtual - modelled))
        predicted = found.transition @ (predicted + found.gain @ innovation)
        modelled = building.transition @ (modelled + found.building_gain @ innovation)
        # What the accelerometer of the table says too much acts on the prediction alone, at both ends of the step.
        wrong = NOISE.acceleration * random.standard_normal(2)
        predicted = predicted + found.before[:, 0] * wrong[0] + found.now[:, 0] * wrong[1]
        floors = FLOORS * random.standard_normal(n)
        true = found.transition @ true + acting @ floors
        virtual = building.transition @ virtual + building.unmodelled @ floors
    row = np.concatenate((np.zeros(2 * n), building.acceleration))
    assert np.std(errors) == pytest.approx(np.sqrt(row @ found.covariance @ row), rel=0.1)


@pytest.mark.parametrize("observer", ["measured_table", "uncertain_table"])
def test_the_assembled_loop_is_the_loop_step_by_step(observer):
    config, ground = exact(mpic__observer=observer), motion()
    loop = closed_loop(config, displacement=True)
    record = RthsLoop(config, ground).run()
    main, drive = noise_streams(config.run.seed)
    noise = np.hstack((main.standard_normal((600, 4)), drive.standard_normal((600, 2))))
    ahead = np.append(ground.acceleration[loop.preview :], np.zeros(loop.preview))[:, None]
    simulation = LinearSimulation(loop.system, loop.start @ ground.acceleration[: loop.preview, None])
    outputs = dict(zip(loop.outputs, simulation.advance(ahead, noise)[0], strict=True))
    for name in ("desired_acceleration", "required_force", "command", "table_displacement"):
        signal = getattr(record, name)
        np.testing.assert_allclose(outputs[name], signal, atol=1e-8 * np.abs(signal).max())
    assert loop.spectral_radius < 1.0


def _joint(make, **changes):
    return make(**changes)


def error_of_the_interface(config, ground):
    record = RthsLoop(config, ground).run()
    assert record.outcome == "finished"
    whole = config.specimen.building().stacked_on(config.numerical_substructure.building())
    reference = reference_response(whole, ground.acceleration, DT)
    return np.std(record.desired_acceleration - reference[:, 0]) / np.std(reference[:, 0])


@pytest.mark.parametrize(
    "wrong",
    [
        {"identified_model__gain": 1.1},
        {"identified_model__servo_real_pole": 38.7},
        {"identified_model__servo_frequency": 148.5},
        {"simulated_table__command_delay": DT},
    ],
)
def test_a_table_that_is_not_its_model_does_not_matter_to_the_interface(wrong):
    ground = motion(800)
    own, joint = (error_of_the_interface(make(quiet, **wrong), ground) for make in (by_measured_table, _joint))
    assert own < 0.02
    assert joint > 2.0 * own


def test_a_lost_measurement_is_bridged_by_what_the_models_would_have_said():
    """A step measured just as the models predict it changes nothing against a step without measurement."""
    control, ground = make_interface_control(by_measured_table(quiet)), np.zeros(4)
    plant, layout = parts()[0], control._layout
    for k in range(30):
        control.step(ground)
        control.learn(TableMeasurement(k, np.nan, 0.0, np.nan, 0.0, 0.0, np.full(2, np.nan)))
    # A shock of the ground that nobody measured: the command moves the table of the model, and its specimen.
    control.step(np.array([1.0, 0.0, 0.0, 0.0]))
    predicted = control._next.copy()
    bridged = control.step(ground)
    table, first, second, displacement = (plant.output @ predicted[layout.plant]).tolist()
    shear = -np.dot(SPECIMEN.masses, (first, second))
    control.reset()
    for _ in range(30):
        control.step(ground)
    control.step(np.array([1.0, 0.0, 0.0, 0.0]))
    control.learn(TableMeasurement(30, np.nan, displacement, table, 0.0, shear, np.array([first, second])))
    measured = control.step(ground)
    # Not the same: between the samples the observer takes the motion of the table as linear.
    np.testing.assert_allclose(measured, bridged, rtol=0.1, atol=1e-9)


def test_joint_observer_has_no_state_for_the_specimen():
    joint, own = (make_interface_control(config)._layout for config in (exact(), by_measured_table()))
    assert joint.specimen.start == joint.specimen.stop
    assert own.states == joint.states + 2 * SPECIMEN.stories


def test_uncertain_table_with_the_error_of_the_joint_observer_is_the_joint_observer():
    """Both filters then are the same, and the one that drives the table is the one that corrects the building."""
    error = Config().section("mpic").command_error
    own, joint = exact(mpic__observer="uncertain_table", mpic__table_error=error), exact()
    first, second = (RthsLoop(config, motion(300)).run() for config in (own, joint))
    for name in ("command", "desired_acceleration", "required_force"):
        signal = getattr(second, name)
        np.testing.assert_allclose(getattr(first, name), signal, rtol=1e-9, atol=1e-9 * np.abs(signal).max())


@pytest.mark.slow
def test_uncertain_table_is_less_misled_than_the_joint_observer_and_has_less_noise_than_the_measured_table():
    wrong, ground = {"identified_model__gain": 1.1}, motion(800)
    joint, loose = (error_of_the_interface(make(quiet, **wrong), ground) for make in (_joint, by_uncertain_table))
    assert loose < 0.5 * joint
    noisy = [error_of_the_interface(make(exact), ground) for make in (by_uncertain_table, by_measured_table)]
    assert noisy[0] < noisy[1]
