"""The quality of a run: every measure against a closed form."""

import dataclasses

import numpy as np
import pytest

from bmd_rths_core.analysis.capture import UNKNOWN, Capture, captured, captures
from bmd_rths_core.analysis.clean_motion import clean_motion
from bmd_rths_core.analysis.frequency_evaluation import frequency_evaluation, frequency_evaluation_over_time
from bmd_rths_core.analysis.metrics import reference_of, run_metrics
from bmd_rths_core.analysis.quality import told_quality
from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.analysis.tracking_quality import response_spectrum, tracking_indicator, tracking_quality
from bmd_rths_core.analysis.true_building import true_specimen
from bmd_rths_core.analysis.verdict import judge
from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.loop.build import make_table_controller
from bmd_rths_core.loop.deadlines import DeadlineMonitor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.sensors import noise_streams
from bmd_rths_core.verdict_bands import VerdictConfig
from tests.core.mpic_parts import exact, motion

DT = 0.005
TIME = DT * np.arange(4000)
SINE = np.sin(2.0 * np.pi * 2.0 * TIME)  # 40 whole periods
WHOLE = Capture(0.97, 1.0)
PERFECT = {"run__scheme": "uc", "simulated_table__dynamics": "perfect", "shear_estimator__source": "load_cell"}


def ran(config, steps=1600):
    return RthsLoop(config, motion(steps)).run()


def moved(config, commands):
    """Return what the sensors of a simulated table say to commands."""
    table = make_table_controller(config)
    table.connect()
    answers = [table.exchange(TableCommand(step, command)) for step, command in enumerate(commands.tolist())]
    return np.array([[answer.table_acceleration, *answer.floor_accelerations] for answer in answers])


@pytest.mark.parametrize("delay", [-0.02, 0.0, 0.0137])
@pytest.mark.parametrize("gain", [0.8, 1.0, 1.3])
def test_delay_and_gain_of_a_sine(gain, delay):
    found = frequency_evaluation(SINE, gain * np.sin(2.0 * np.pi * 2.0 * (TIME - delay)), DT)
    assert found == pytest.approx((gain, 1e3 * delay, 2.0), abs=1e-9)


def test_pure_gain_of_any_signal():
    signal = motion(2000).acceleration
    evaluation = frequency_evaluation(signal, -0.5 * signal, DT)
    assert evaluation.amplitude == pytest.approx(0.5)
    assert frequency_evaluation(signal, 0.5 * signal, DT).delay_ms == pytest.approx(0.0, abs=1e-9)


def test_delay_over_time_follows_a_change():
    late = np.where(TIME < 10.0, 0.004, 0.016)
    achieved = 1.1 * np.sin(2.0 * np.pi * 2.0 * (TIME - late))
    times, found = frequency_evaluation_over_time(SINE, achieved, DT)
    assert times[0] == pytest.approx(1.0)
    assert [e.delay_ms for t, e in zip(times, found, strict=True) if t <= 9.0] == pytest.approx([4.0] * 17, abs=0.02)
    assert [e.delay_ms for t, e in zip(times, found, strict=True) if t >= 11.0] == pytest.approx([16.0] * 17, abs=0.02)
    assert [e.amplitude for e in found] == pytest.approx([1.1] * len(found), rel=0.03)


def test_nothing_is_evaluated_of_a_table_that_was_not_asked_to_move():
    assert np.isnan(frequency_evaluation(np.zeros(100), np.ones(100), DT)).all()
    assert frequency_evaluation_over_time(np.zeros(1000), np.zeros(1000), DT)[1] == []
    assert frequency_evaluation_over_time(np.zeros(10), np.zeros(10), DT)[1] == []


def test_tracking_indicator_of_a_sine():
    phase = 0.3
    late = np.sin(2.0 * np.pi * 2.0 * TIME - phase)
    per_period = np.diff(tracking_indicator(SINE, late)[::100])
    assert per_period == pytest.approx(np.full(len(per_period), np.pi * np.sin(phase)), rel=1e-3)  # trapezoids
    assert tracking_indicator(SINE, 1.7 * SINE) == pytest.approx(np.zeros(len(SINE)), abs=1e-12)
    assert tracking_quality(SINE, late, DT, 0.0).indicator == pytest.approx(np.sin(phase), rel=1e-2)


def test_response_spectrum_of_a_sine():
    frequency, damping = 3.0, 0.2
    long = np.sin(2.0 * np.pi * frequency * 0.001 * np.arange(20_000))
    ratios = np.array([0.5, 1.0, 2.0])
    spectrum = response_spectrum(long, 0.001, frequency / ratios, damping)
    # Absolute acceleration over that of the base in the steady state (Chopra, Eq. 3.5.3).
    transmitted = np.sqrt((1 + (2 * damping * ratios) ** 2) / ((1 - ratios**2) ** 2 + (2 * damping * ratios) ** 2))
    assert spectrum[1] == pytest.approx(transmitted[1], rel=1e-3)
    assert response_spectrum(long, 0.001, np.array([400.0]), 0.05) == pytest.approx([1.0], rel=1e-2)


def test_tracking_of_a_pure_gain():
    signal = motion(2000).acceleration
    good, high, low = (tracking_quality(signal, gain * signal, DT, 0.0) for gain in (1.0, 1.35, 0.85))
    assert (good.error_percent, good.peak_ratio, good.spectrum_out_percent) == (0.0, 1.0, 0.0)
    assert (high.error_percent, high.peak_ratio, high.spectrum_out_percent) == pytest.approx((35.0, 1.35, 100.0))
    assert (low.error_percent, low.peak_ratio, low.spectrum_out_percent) == pytest.approx((15.0, 0.85, 100.0))
    assert tracking_quality(signal, 1.29 * signal, DT, 0.0).spectrum_out_percent == 0.0


def test_noise_of_the_sensor_is_no_tracking_error():
    noise = 0.1 * np.random.default_rng(0).standard_normal(len(SINE))
    assert tracking_quality(SINE, 1.2 * SINE + noise, DT, 0.1).error_percent == pytest.approx(20.0, rel=0.03)


def test_noise_is_taken_away_exactly():
    config = Config().changed(run__seed=7)
    record = ran(config)
    clean = clean_motion(record, config)
    silent = config.changed(simulated_table__acceleration_noise=0.0)
    replayed = moved(silent, record.applied_command)
    assert np.abs(clean.table - replayed[:, 0]).max() < 1e-12
    assert np.abs(clean.floors - replayed[:, 1:]).max() < 1e-12
    assert clean.origin == "simulated"
    assert np.std(record.table_acceleration - clean.table) == pytest.approx(0.0524, rel=0.05)


def test_errors_of_known_noise_and_a_hybrid_test_without_error():
    """A record that is the true building, with noise of 10 % on the floors: floor 10, true 10, clean 0, excess 0."""
    config = Config().changed(**PERFECT, simulated_table__specimen_stiffness_factor=1.1)
    record = ran(config)
    truth = reference_of(record, config.changed(specimen__stiffnesses=true_specimen(config).building.stiffnesses))
    noise = 0.0524 * noise_streams(0)[0].standard_normal((record.steps, 4))
    following = np.vstack((truth[1:], truth[-1:]))
    made = dataclasses.replace(
        record,
        desired_acceleration=truth[:, 0],
        table_acceleration=following[:, 0] + noise[:, 0],
        floor_accelerations=following[:, 1:] + noise[:, 1:-1],
    )
    quality = analysed(made, capture=False).quality
    assert quality.rmse_clean_percent == pytest.approx(dict.fromkeys(quality.rmse_clean_percent, 0.0), abs=1e-9)
    assert quality.rmse_true_percent["substructure"] == pytest.approx(0.0, abs=1e-9)
    for name, column in (("control_layer", 1), ("superstructure", 2)):
        floor = 100.0 * 0.0524 / np.sqrt(np.mean(truth[1:, column] ** 2))
        assert quality.noise_floor_percent[name] == pytest.approx(floor)
        assert quality.rmse_true_percent[name] == pytest.approx(floor, rel=0.05)
        assert quality.excess_percent[name] < 0.4 * floor  # the noise of one record is not its mean
    assert np.isnan(quality.noise_floor_percent["substructure"])
    nominal = run_metrics(made).rmse_percent
    assert nominal["superstructure"] > 2.0 * quality.rmse_true_percent["superstructure"]


def test_captured_share_of_known_changes():
    change = np.array([1.0, -2.0, 3.0])
    assert captured(change, change) == pytest.approx(1.0)
    assert captured(0.3 * change, change) == pytest.approx(0.3)
    assert captured(np.array([2.0, 1.0, 0.0]), change) == pytest.approx(0.0)
    assert np.isnan(captured(change, np.zeros(3)))
    assert np.isnan(captured(np.array([np.inf, 0.0, 0.0]), change))


def test_a_perfect_hybrid_test_captures_all():
    fine = Config().changed(**PERFECT, run__time_step=0.0005)
    ground = np.interp(np.arange(16_000) * 0.0005, np.arange(1600) * DT, motion(1600).acceleration)
    assert captures(fine, [ground])[0] == pytest.approx((1.0, 1.0), abs=0.02)


def test_a_simulation_captures_nothing():
    """Of the interface; the specimen on the table is real, and its floors are measured."""
    simulation = captures(exact(mpic__model_error=1e-5, mpic__command_error=1e-5), [motion(1600).acceleration])[0]
    assert simulation.substructure == pytest.approx(0.0, abs=1e-3)
    assert min(captures(exact(mpic__model_error=3.0), [motion(1600).acceleration])[0]) > 0.95


def test_capture_by_matrices_is_that_by_stages(monkeypatch):
    config, ground = Config().changed(run__scheme="plc_fc"), motion(800).acceleration
    by_matrices = captures(config, [ground])[0]
    monkeypatch.setattr("bmd_rths_core.analysis.capture.is_cheap", lambda config: False)
    assert captures(config, [ground])[0] == pytest.approx(by_matrices, rel=1e-4)


def test_capture_of_another_table_is_not_known():
    config = Config().changed(table__controller="udp")
    assert np.isnan(captures(config, [motion(100).acceleration])[0]).all()


def test_on_a_rig_errors_are_against_the_identified_specimen():
    config = Config().changed(run__scheme="uc")
    stiffer = [1.049 * k for k in config.specimen.stiffnesses]
    record = ran(config.changed(simulated_table__specimen_stiffness_factor=1.049))
    mapping = {**record.configuration, "table": {**record.configuration["table"], "controller": "udp"}}
    unknown = analysed(dataclasses.replace(record, configuration=mapping)).quality
    assert unknown.specimen is None
    assert np.isnan(list(unknown.rmse_true_percent.values())).all()
    model = {"stiffnesses": stiffer, "damping_coefficients": list(config.specimen.damping_coefficients)}
    mapping["identified_model"] = {**mapping["identified_model"], **model}
    rig = analysed(dataclasses.replace(record, configuration=mapping)).quality
    simulated = analysed(record).quality
    assert (rig.specimen, rig.clean.origin) == ("identified", "estimated")
    assert rig.rmse_true_percent == pytest.approx(simulated.rmse_true_percent)
    true_floors = simulated.clean.floors
    estimated, raw = (np.std(floors - true_floors) for floors in (rig.clean.floors, record.floor_accelerations))
    assert estimated < raw
    assert rig.tracking.error_percent == pytest.approx(simulated.tracking.error_percent, rel=0.02)


def judged(outcome="finished", error=5.0, delay=1.0, capture=WHOLE, timing=None, **bands):
    record = dataclasses.replace(ran(Config(), 40), outcome=outcome, timing=timing)
    return judge(record, error, delay, capture, VerdictConfig(**bands))


def test_green_only_where_all_bands_hold():
    assert judged() == ("green", ())
    assert judged(error=102.0).verdict == "red"
    assert judged(error=102.0).reasons == ("The tracking error is 102.0 %; at most 20 % is required.",)
    assert judged(delay=-3.0).verdict == "red"
    assert judged(capture=Capture(1.0, 0.5)).verdict == "red"
    assert judged(capture=UNKNOWN).verdict == "unjudged"
    assert judged(capture=UNKNOWN, error=102.0).verdict == "red"
    assert judged(error=float("nan")).verdict == "unjudged"
    assert judged(outcome="stopped").verdict == "red"
    assert judged(error=5.0, largest_tracking_error=4.0).verdict == "red"
    assert judged(error=102.0, largest_tracking_error=110.0).verdict == "green"


def test_a_run_that_was_not_in_real_time_is_not_green():
    few, many = DeadlineMonitor(DT, 1.0), DeadlineMonitor(DT, 1.0)
    for monitor, missed in ((few, 0), (many, 20)):
        for step in range(missed):
            monitor.opened(step, 0.005 * step, 0.005 * (step + 1))
            monitor.expired(0.005 * (step + 1))
    assert judged(timing=few.statistics()).verdict == "green"
    verdict, (reason,) = judged(timing=many.statistics())
    assert verdict == "red"
    assert reason == "It was not in real time: 50.0 % of the steps were late; at most 1 % is allowed."


def test_a_finished_run_of_the_paper_is_not_green():
    analysis = analysed(ran(Config().changed(run__scheme="plc_fc")))
    assert analysis.record.outcome == "finished"
    assert analysis.quality.judgement.verdict == "red"


def test_what_is_told_has_every_key_also_of_a_run_without_steps():
    record = ran(Config(), 40)
    nothing = {name: signal[:0] for name, signal in record.signals().items()}
    empty = dataclasses.replace(record, outcome="limit", **nothing)
    told, whole = (told_quality(analysed(entry).quality, entry.stable) for entry in (empty, record))
    assert told.keys() == whole.keys()
    assert told["rmse_true_percent"] == {"substructure": None, "control_layer": None, "superstructure": None}
    assert told["capture"] == {"substructure": None, "superstructure": None}
    assert told["verdict"] == "red"


def test_bands_are_configured():
    assert config_from_mapping({"verdict": {"smallest_capture": 0.5}}).verdict.smallest_capture == 0.5
