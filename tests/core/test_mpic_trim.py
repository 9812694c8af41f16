"""Trim of MPIC: it finds gain and delay within bounds and rates, and is recorded over time."""

import numpy as np
import pytest

from bmd_rths_core.loop.adaptation import adapted_over_time
from bmd_rths_core.loop.build import make_interface_control
from bmd_rths_core.loop.closed_loop import closed_loop, has_matrices
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.simulated import SimulatedTable
from tests.core.mpic_parts import DT, exact, motion, quiet


def trimmed(make=quiet, **changes):
    return make(mpic__trim=True, **changes)


def driven(config, steps=2000, scale=10.0):
    """Return what the trim finds when the control drives a table along a strong motion of the ground."""
    control = make_interface_control(config)
    table = SimulatedTable(config.simulated_table, config.specimen.building(), DT, 0)
    ground = np.append(scale * motion(steps).acceleration, np.zeros(control.preview))
    found = []
    for k in range(steps):
        command = control.step(ground[k : k + control.preview + 1]).command
        control.learn(table.exchange(TableCommand(k, command)))
        found.append(tuple(control.adapted.values()))
    return np.array(found)


def test_a_table_as_identified_is_left_alone():
    found = driven(trimmed())
    np.testing.assert_allclose(found[:, 0], 1.0, atol=0.02)
    np.testing.assert_allclose(found[:, 1], 0.0, atol=1e-3)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_gain_is_found(factor):
    """The identified table is too strong or too weak; the real one has the inverse gain to it."""
    found = driven(trimmed(identified_model__gain=factor))
    assert found[-1, 0] == pytest.approx(1.0 / factor, abs=0.02)
    assert np.abs(np.diff(found[:, 0])).max() <= 0.1 * DT + 1e-12


def test_delay_is_found_and_stays_within_its_bound():
    free = driven(trimmed(simulated_table__command_delay=0.004))
    assert free[-1, 1] == pytest.approx(0.004, abs=0.0015)
    assert np.abs(np.diff(free[:, 1])).max() <= 0.003 * DT + 1e-15
    bound = driven(trimmed(simulated_table__command_delay=0.004, mpic__trim_largest_delay=0.001))
    assert bound[:, 1].max() == pytest.approx(0.001, abs=1e-9)


def test_nothing_moves_while_the_table_is_quiet():
    found = driven(trimmed(identified_model__gain=1.1), steps=600, scale=0.1)
    assert (found == (1.0, 0.0)).all()


def test_trim_is_recorded_over_time_and_repeats():
    config, ground = trimmed(exact, identified_model__gain=1.1, mpic__trim_quiet_acceleration=0.0), motion(700)
    loop = RthsLoop(config, ground)
    record = loop.run()
    found = adapted_over_time(config, record)
    assert list(found) == ["table_gain", "table_delay"]
    assert found["table_gain"][0] == 1.0
    assert found["table_gain"].shape == record.command.shape
    assert np.ptp(found["table_gain"]) > 0.01
    assert adapted_over_time(exact(), record) == {}
    again = RthsLoop(config, ground).run()
    assert again.same_signals(record)


def test_reset_repeats_the_run():
    config = trimmed(exact, identified_model__gain=1.1, mpic__trim_quiet_acceleration=0.0)
    control = make_interface_control(config)
    runs = []
    for _ in range(2):
        control.reset()
        table = SimulatedTable(config.simulated_table, config.specimen.building(), DT, 0)
        demands = []
        for k in range(60):
            demands.append(control.step(np.full(4, np.sin(0.3 * k))))
            if k not in (20, 21):
                control.learn(table.exchange(TableCommand(k, demands[-1].command)))
        runs.append((demands, dict(control.adapted)))
    assert runs[0] == runs[1]


def test_stability_takes_it_as_it_begins():
    assert not has_matrices(trimmed(exact))
    assert closed_loop(trimmed(exact)).spectral_radius == closed_loop(exact()).spectral_radius


def test_a_trim_that_may_not_move_changes_nothing_at_all():
    held = {"mpic__trim_largest_gain": 1.0, "mpic__trim_largest_delay": 0.0}
    first, second = (RthsLoop(config, motion(300)).run() for config in (trimmed(exact, **held), exact()))
    np.testing.assert_allclose(first.command, second.command, rtol=1e-12, atol=1e-15)
