"""Adaptation of MPIC to the stiffness of the stories: what it finds, within what bounds, and what it designs for it."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from bmd_rths_core.analysis.metrics import rmse_percent
from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.analysis.true_building import simulated_references_of
from bmd_rths_core.compensators.mpic.adaptation import stiffened
from bmd_rths_core.compensators.mpic.design import design, design_in_pieces
from bmd_rths_core.compensators.mpic.riccati import by_doubling, finished
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.adaptation import adapted_over_time
from bmd_rths_core.loop.build import make_interface_control, make_known
from bmd_rths_core.loop.closed_loop import closed_loop, has_matrices
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.sections import adaptation
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.simulated import SimulatedTable
from tests.core.mpic_parts import DT, exact, motion, quiet

SECTIONS = [1.0, 1.2, 3000.0, 1.0, 1.1, 2900.0, 0.0, 0.0, 60.0, 0.0, 1.0, 60.0]


def adapting(make=exact, **changes):
    return make(mpic__stiffness=True, **changes)


def driven(config, steps=2400, scale=10.0, lost=()):
    """Return the factors when the control drives a table along a strong motion of the ground."""
    control = make_interface_control(config)
    table = SimulatedTable(config.simulated_table, config.specimen.building(), DT, 0)
    ground = np.append(scale * motion(steps).acceleration, np.zeros(control.preview))
    found = []
    for k in range(steps):
        measured = table.exchange(TableCommand(k, control.step(ground[k : k + control.preview + 1]).command))
        if k not in lost:
            control.learn(measured)
        found.append(tuple(control.adapted.values()))
    return np.array(found)


def test_doubling_solves_the_riccati_equation():
    random = np.random.default_rng(5)
    a, b = random.standard_normal((9, 9)) / 3.0, random.standard_normal((9, 2))
    q, r = np.diag(random.uniform(0.0, 2.0, 9)), np.diag([0.5, 2.0])
    np.testing.assert_allclose(finished(by_doubling(a, b, q, r)), solve_discrete_are(a, b, q, r), rtol=1e-9, atol=1e-9)
    with pytest.raises(np.linalg.LinAlgError), np.errstate(all="ignore"):
        finished(by_doubling(np.diag([2.0, 0.5]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1)))


@pytest.mark.parametrize(
    "table",
    [{}, {"identified_model__table": "sections", "identified_model__sections": SECTIONS}],
    ids=["servo", "rows"],
)
def test_stiffened_plant_is_that_of_the_stiffer_specimen(table):
    config, factors = exact(**table), np.array([0.8, 1.1])
    specimen = config.specimen.building()
    stiffnesses = (factors * np.array(specimen.stiffnesses)).tolist()
    own = {"stiffnesses": stiffnesses, "damping_coefficients": specimen.damping_coefficients}
    expected = make_known(config.changed(**{f"identified_model__{name}": value for name, value in own.items()}))
    found = stiffened(make_known(config), factors)
    assert found.specimen.stiffnesses == pytest.approx(expected.specimen.stiffnesses)
    np.testing.assert_allclose(found.table.a, expected.table.a, rtol=1e-12, atol=1e-7)
    np.testing.assert_allclose(found.table.output, expected.table.output, rtol=1e-12, atol=1e-7)
    assert (found.table.b == expected.table.b).all()


@pytest.mark.parametrize("observer", ["joint", "measured_table"])
def test_design_in_pieces_is_the_design(observer):
    known = make_known(exact(mpic__observer=observer))
    work, pieces = design_in_pieces(known, by_doubling), 0
    while True:
        try:
            next(work)
            pieces += 1
        except StopIteration as end:
            found = end.value
            break
    expected = design(known)
    assert 15 < pieces < 60
    scale = np.abs(expected.measured).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found.measured / scale, expected.measured / scale, atol=1e-6)
    np.testing.assert_allclose(found.start, expected.start)


@pytest.mark.parametrize("source", ["load_cell", "kalman"])
@pytest.mark.parametrize("factor", [0.8, 1.0, 1.15])
def test_factors_are_found_under_noise(factor, source):
    config = adapting(simulated_table__specimen_stiffness_factor=factor).changed(shear_estimator__source=source)
    found = driven(config)
    np.testing.assert_allclose(found[-1], factor, atol=0.03)
    assert np.abs(np.diff(found, axis=0)).max() <= 0.25 * DT + 1e-12


def test_noise_is_taken_away():
    """Noise that the model of the sensors does not have makes a story seem stiffer or softer than it is."""
    noisy = {"simulated_table__acceleration_noise": 0.2, "simulated_table__specimen_stiffness_factor": 0.9}
    told = driven(adapting(**noisy, identified_model__acceleration_noise=0.2))
    untold = driven(adapting(**noisy))
    assert np.abs(told[-1] - 0.9).max() < 0.5 * np.abs(untold[-1] - 0.9).max()


def test_bounds_hold_and_nothing_moves_while_the_drift_is_small():
    bound = driven(adapting(simulated_table__specimen_stiffness_factor=0.7, mpic__stiffness_least=0.85))
    assert bound.min() == pytest.approx(0.85)
    assert (driven(adapting(simulated_table__specimen_stiffness_factor=0.8), steps=600, scale=0.05) == 1.0).all()


def test_a_gap_stops_the_adaptation_until_it_is_forgotten():
    config = adapting(simulated_table__specimen_stiffness_factor=0.8)
    found = driven(config, steps=1400, lost=range(1000, 1004))
    whole = driven(config, steps=1400)
    assert (found[:1000] == whole[:1000]).all()
    assert (found[1004:1203] == found[1000]).all()


@pytest.mark.slow
def test_a_specimen_that_softens_is_followed_and_recorded():
    soft = {"simulated_table__softening_factor": 0.8, "simulated_table__softening_time": 2.0}
    config = adapting(**soft).changed(shear_estimator__source="kalman")
    ground = dataclasses.replace(motion(2000), acceleration=10.0 * motion(2000).acceleration)
    (reference,) = simulated_references_of([ground.acceleration], config)
    record, fixed = (RthsLoop(own, ground).run() for own in (config, config.changed(mpic__stiffness=False)))
    adapted, held = (rmse_percent(reference[:, 0], run.desired_acceleration) for run in (record, fixed))
    assert adapted < 0.7 * held
    found = adapted_over_time(config, record)
    assert list(found) == ["story_1_stiffness", "story_2_stiffness"]
    assert found["story_1_stiffness"][-1] == pytest.approx(0.8, abs=0.04)
    assert RthsLoop(config, ground).run().same_signals(record)


def test_report_shows_what_was_adapted_and_says_where_nothing_is():
    config, ground = adapting(mpic__trim=True), motion(300)
    record = RthsLoop(config, ground).run()
    table, shown = adaptation.blocks(ReportedRun(analysed(record, capture=False), "no clock"))
    assert [row[0] for row in table.rows] == ["table gain", "table delay", "story 1 stiffness", "story 2 stiffness"]
    assert table.rows[0][1:] == ("1.0000", "1.0000", "1.0000", "1.0000")
    values = adapted_over_time(config, record)
    assert all((shown.drawing.values[name] == own).all() for name, own in values.items())
    (told,) = adaptation.blocks(ReportedRun(analysed(RthsLoop(exact(), ground).run(), capture=False), "no clock"))
    assert told.text == "mpic adapts nothing."


def test_both_options_at_once_tell_both():
    control = make_interface_control(adapting(mpic__trim=True))
    assert list(control.adapted) == ["table_gain", "table_delay", "story_1_stiffness", "story_2_stiffness"]
    assert closed_loop(adapting(mpic__trim=True)).spectral_radius == closed_loop(exact()).spectral_radius


def test_stability_takes_it_as_it_begins_and_a_reset_repeats():
    config = adapting(quiet, simulated_table__specimen_stiffness_factor=0.8)
    assert not has_matrices(config)
    assert closed_loop(config).spectral_radius == closed_loop(config.changed(mpic__stiffness=False)).spectral_radius
    control, runs = make_interface_control(config), []
    for _ in range(2):
        control.reset()
        table = SimulatedTable(config.simulated_table, config.specimen.building(), DT, 0)
        ground, commands = 10.0 * motion(900).acceleration, []
        for k in range(890):
            commands.append(control.step(ground[k : k + 4]).command)
            control.learn(table.exchange(TableCommand(k, commands[-1])))
        runs.append((commands, dict(control.adapted)))
    assert runs[0] == runs[1]
    assert runs[0][1]["story_1_stiffness"] < 0.95


def test_refuses_a_band_that_is_none():
    with pytest.raises(InputError, match=r"stiffness_upper_frequency: 3 and 200 Hz are not allowed"):
        make_interface_control(adapting(mpic__stiffness_upper_frequency=200.0))
