"""Replay: the recording again bit for bit, the steps that cannot be known, and what other parameters change."""

from dataclasses import replace

import numpy as np
import pytest

from bmd_rths_core.analysis.replay import answered_replay, changed_parameters, measured_steps, replay
from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stages.shear_estimator import ShearEstimator
from tests.conftest import WITHOUT_LIMITS

FORCES = ("interface_force", "corrected_force")


def run(**changes):
    config = Config().changed(ground_motion__duration=2.0, **changes)
    return config, RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


def without(record, steps, *names):
    """Return a record some of whose values were not recorded."""
    changed = {}
    for name in names:
        changed[name] = getattr(record, name).copy()
        changed[name][steps] = np.nan
    return replace(record, **changed)


MEASUREMENT = (
    *("applied_command", "table_displacement", "table_acceleration", "actuator_force", "base_shear"),
    "floor_accelerations",
)


@pytest.mark.parametrize("scheme", SCHEME_NAMES)
@pytest.mark.parametrize("source", ["kalman", "load_cell"])
def test_same_parameters_give_the_recording_bit_for_bit(scheme, source):
    config, record = run(run__scheme=scheme, shear_estimator__source=source)
    done = replay(record, config)
    assert done.replayed.same_signals(record)
    for difference in done.differences().values():
        assert (difference.compared, difference.differing, difference.missing) == (401, 0, 0)
        assert (difference.first_step, difference.largest_step, difference.rmse, difference.largest) == (
            None,
            None,
            0,
            0,
        )


def test_run_that_a_limit_ended_is_replayed_up_to_its_last_measurement():
    config, record = run(safety__acceleration_limit=1.0, safety__ramp_acceleration=1.0)
    assert record.outcome == "limit"
    done = replay(record, config)
    assert done.replayed.same_signals(record)
    assert done.differences()["interface_force"].compared == record.steps - 1


def test_other_parameters_give_what_a_run_with_them_would_have_computed_from_the_same_measurements():
    """The gain of the correction by hand: s f - g (required - s f)."""
    config, record = run()
    done = replay(record, config.changed(force_correction__gain=0.3, force_correction__feedback_scale=0.8))
    shear = 0.8 * record.interface_force
    np.testing.assert_allclose(done.replayed.corrected_force, shear - 0.3 * (record.required_force - shear), rtol=1e-12)
    assert np.array_equal(done.replayed.interface_force, record.interface_force)
    assert done.differences()["corrected_force"].differing == 401


def test_differences_are_those_of_the_definitions():
    config, record = run()
    done = replay(record, config.changed(shear_estimator__source="load_cell"))
    apart = record.base_shear - record.interface_force
    difference = done.differences()["interface_force"]
    assert np.array_equal(done.replayed.interface_force, record.base_shear)
    assert difference.rmse == pytest.approx(np.sqrt(np.mean(apart**2)), rel=1e-12)
    assert difference.rmse_percent == pytest.approx(
        100 * np.linalg.norm(apart) / np.linalg.norm(record.interface_force), rel=1e-12
    )
    assert difference.largest == np.abs(apart).max()
    assert difference.largest_step == np.abs(apart).argmax()


def test_first_step_that_differs_is_found_and_the_last_bit_counts():
    config, record = run()
    tampered = record.interface_force.copy()
    tampered[[7, 300]] = np.nextafter(tampered[[7, 300]], np.inf)
    difference = replay(replace(record, interface_force=tampered), config).differences()["interface_force"]
    assert (difference.differing, difference.first_step) == (2, 7)


def test_steps_that_a_node_skipped_are_skipped_again():
    """What a real-time run does: a measurement that does not arrive leaves the filter where it was."""
    config, record = run()
    skipped = np.array([50, 51, 52, 200])
    estimator = ShearEstimator(config.shear_estimator, config.specimen.building(), config.run.time_step)
    interface = np.full(record.steps, np.nan)
    for step in np.setdiff1d(np.arange(record.steps), skipped):
        interface[step] = estimator.step(
            type("Measurement", (), {name: getattr(record, name)[step] for name in MEASUREMENT})
        )
    recorded = replace(record, interface_force=interface, corrected_force=np.full(record.steps, np.nan))
    done = replay(recorded, config)
    assert np.array_equal(done.replayed.interface_force, interface, equal_nan=True)
    assert done.differences()["interface_force"].compared == record.steps - len(skipped)
    assert done.unknown_steps("interface_force") == []


def test_force_correction_that_had_no_shear_in_time_is_skipped_again():
    config, record = run()
    recorded = without(record, [10, 20], "corrected_force")
    done = replay(recorded, config)
    assert done.replayed.same_signals(recorded)
    assert done.differences()["corrected_force"].compared == record.steps - 2


def test_estimate_that_was_not_recorded_is_known_from_the_force_that_was_made_from_it():
    config, record = run()
    done = replay(without(record, [30], "interface_force"), config)
    assert np.array_equal(done.replayed.interface_force, record.interface_force)
    assert all(difference.differing == 0 for difference in done.differences().values())


@pytest.mark.parametrize(("source", "unknown"), [("kalman", [(100, 400)]), ("load_cell", [(100, 100)])])
def test_only_a_filter_is_unknown_after_a_measurement_that_was_not_recorded(source, unknown):
    config, record = run(shear_estimator__source=source)
    done = replay(without(record, [100], *MEASUREMENT), config)
    assert [done.unknown_steps(name) for name in FORCES] == [unknown, unknown]
    assert all(difference.differing == 0 for difference in done.differences().values())


def test_filter_is_unknown_after_a_gap_of_the_whole_recording():
    config, record = run()
    everything = tuple(record.signals())
    done = replay(without(record, [100, 101], *everything), config)
    assert done.unknown_steps("interface_force") == [(102, 400)]
    assert done.differences()["interface_force"].compared == 100
    assert done.differences()["interface_force"].differing == 0


def test_required_force_that_was_not_recorded_leaves_one_step_unknown():
    config, record = run()
    done = replay(without(record, [5], "required_force"), config)
    assert done.unknown_steps("corrected_force") == [(5, 5)]
    assert done.unknown_steps("interface_force") == []
    assert done.differences()["corrected_force"].differing == 0


def test_value_that_the_replay_lacks_differs():
    config, record = run()
    blind = without(record, slice(None), "floor_accelerations")
    difference = replay(blind, config).differences()["interface_force"]
    assert (difference.compared, difference.differing, difference.missing) == (401, 401, 401)


def test_laboratory_without_some_sensors_has_measurements():
    _, record = run()
    assert measured_steps(without(record, slice(None), "actuator_force", "base_shear")).all()
    assert not measured_steps(without(record, [3], *MEASUREMENT))[3]


def test_answers_of_other_nodes_are_compared_where_the_run_had_every_measurement():
    _, record = run()
    answers = {name: dict(enumerate(getattr(record, name).tolist())) for name in FORCES}
    assert answered_replay(record, answers).replayed.same_signals(record)
    del answers["corrected_force"][8]
    missing = answered_replay(record, answers).differences()["corrected_force"]
    assert (missing.differing, missing.first_step, missing.missing) == (1, 8, 1)
    done = answered_replay(without(record, [60], *FORCES), answers)
    assert done.unknown_steps("interface_force") == [(61, 400)]


def test_changed_parameters_are_told_with_those_that_have_no_effect():
    before = Config()
    after = before.changed(force_correction__gain=0.4, run__scheme="fc", run__seed=3, command_shaper__lead_time=0.01)
    effective, idle = changed_parameters(before, after)
    assert effective == {"run.scheme": ("plc_fc", "fc"), "force_correction.gain": (0.5, 0.4)}
    assert sorted(idle) == ["command_shaper.lead_time", "run.seed"]


def test_record_of_a_replay_tells_what_it_is():
    config, record = run()
    replayed = replay(record, config.changed(force_correction__gain=0.4)).replayed
    assert replayed.configuration["force_correction"]["gain"] == 0.4
    assert replayed.reason == f"{record.reason}; interface and corrected force are those of a replay"


def test_other_time_step_or_specimen_is_refused():
    config, record = run()
    with pytest.raises(InputError, match=r"^run\.time_step: 0\.01 s; that of the recording, 0\.005 s$"):
        replay(record, config.changed(run__time_step=0.01))
    one_floor = {f"specimen__{name}": [1000.0] for name in ("masses", "stiffnesses", "damping_coefficients")}
    with pytest.raises(InputError, match=r"specimen\.masses: 1 entries; 2 are required"):
        replay(record, config.changed(**one_floor, **WITHOUT_LIMITS))
    nothing = replace(record, floor_accelerations=np.empty((record.steps, 0)))
    with pytest.raises(InputError, match="no measurement is recorded"):
        replay(nothing, config)
