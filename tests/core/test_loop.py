"""The loop in process: convergence to the reference, order of the schemes, limits, determinism."""

import gc
import tracemalloc

import numpy as np
import pytest

from bmd_rths_core.analysis.metrics import run_metrics
from bmd_rths_core.analysis.reference import reference_response
from bmd_rths_core.compensators.schemes import Scheme
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.rths_loop import RthsLoop

IDEAL = Config().changed(
    run__scheme="uc",
    simulated_table__dynamics="perfect",
    simulated_table__acceleration_noise=0.0,
    simulated_table__shear_noise=0.0,
    simulated_table__displacement_noise=0.0,
    simulated_table__force_noise=0.0,
)
EL_CENTRO = select_ground_motion(Config().ground_motion, 0.005)


def synthetic(time_step, duration=3.0):
    time = np.arange(round(duration / time_step) + 1) * time_step
    acceleration = np.sin(2 * np.pi * 3.1 * time) * np.sin(np.pi * time / duration) ** 2
    return GroundMotion("synthetic", time_step, acceleration, "test", "0" * 64)


@pytest.mark.parametrize("source", ["load_cell", pytest.param("kalman", marks=pytest.mark.slow)])
def test_loop_with_a_perfect_table_converges_to_the_reference_with_first_order(source):
    """A hold of one step and nothing else: halving Δt halves the error."""
    errors = []
    for time_step in (0.005, 0.0025, 0.00125, 0.000625):
        config = IDEAL.changed(run__time_step=time_step, shear_estimator__source=source)
        motion = synthetic(time_step)
        record = RthsLoop(config, motion).run()
        building = config.specimen.building().stacked_on(config.numerical_substructure.building())
        reference = reference_response(building, motion.acceleration, time_step)[:, 0]
        errors.append(np.sqrt(np.mean((record.desired_acceleration - reference) ** 2) / np.mean(reference**2)))
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert order == pytest.approx(1.0, abs=0.15)
    assert errors[-1] < 0.02


@pytest.mark.slow
def test_schemes_keep_the_order_of_the_paper_on_el_centro():
    rmse = {}
    for scheme in Scheme:
        record = RthsLoop(Config().changed(run__scheme=scheme.value), EL_CENTRO).run()
        assert record.outcome == "finished"
        rmse[scheme] = run_metrics(record).rmse_percent["substructure"]
    assert rmse[Scheme.UC] > rmse[Scheme.FC] > rmse[Scheme.PLC] >= rmse[Scheme.PLC_FC]


def test_same_seed_gives_the_same_run_and_another_seed_another():
    motion = synthetic(0.005)
    first, again = (RthsLoop(Config(), motion).run() for _ in range(2))
    other = RthsLoop(Config().changed(run__seed=1), motion).run()
    assert first.same_signals(again)
    assert not first.same_signals(other)


def test_loop_can_be_run_again():
    loop = RthsLoop(Config(), synthetic(0.005))
    assert loop.run().same_signals(loop.run())


def test_a_limit_ends_the_run_at_the_step_that_passed_it():
    config = Config().changed(safety__acceleration_limit=0.5, safety__ramp_acceleration=0.5)
    record = RthsLoop(config, synthetic(0.005)).run()
    assert record.outcome == "limit"
    assert not record.stable
    assert record.steps < 601
    assert abs(record.command[-1]) > 0.5 >= np.abs(record.command[:-1]).max()
    assert np.isnan(record.table_acceleration[-1])
    assert np.isfinite(record.table_acceleration[:-1]).all()
    assert f"safety.acceleration_limit [m/s2] passed at step {record.steps - 1}" in record.reason


def test_unstable_loop_is_stopped_by_the_stability_indicator():
    """A numerical mass far below the allowable one makes the uncompensated loop diverge."""
    config = Config().changed(
        run__scheme="uc",
        numerical_substructure__masses=[1500.0],
        numerical_substructure__stiffnesses=[1500.0 * 94.09**2],
        numerical_substructure__damping_coefficients=[2 * 0.0167 * 94.09 * 1500.0],
    )
    record = RthsLoop(config, EL_CENTRO).run()
    assert record.outcome == "limit"


@pytest.mark.slow
def test_full_force_correction_gain_accumulates_noise_at_the_nyquist_frequency():
    """The measurement behind decision 0003: gain 1 feeds back an alternating force that grows without an earthquake."""
    rest = GroundMotion("rest", 0.005, np.zeros(8000), "test", "0" * 64)

    def alternating(gain):
        record = RthsLoop(Config().changed(run__scheme="fc", force_correction__gain=gain), rest).run()
        signs = np.where(np.arange(2000) % 2 == 0, 1.0, -1.0)
        return [abs(np.mean(record.corrected_force[i : i + 2000] * signs)) for i in (0, 6000)]

    begin, end = alternating(1.0)
    assert end > 3.0 * begin
    assert max(alternating(0.5)) < 0.1 * end


def test_progress_reports_every_period_and_the_end():
    seen = []
    RthsLoop(Config(), synthetic(0.005)).run(progress=seen.append)
    assert seen == [200, 400, 600, 601]


@pytest.mark.slow
def test_repeated_tests_in_one_process_do_not_grow():
    """The collector is asked first: what it has not come to yet is not kept."""
    config = Config().changed(ground_motion__duration=0.1)
    motion = select_ground_motion(config.ground_motion, config.run.time_step)

    def kept_after(tests):
        for _ in range(tests):
            RthsLoop(config, motion).run()
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        begin = kept_after(120)  # the caches of the interpreter fill more and more slowly
        assert kept_after(20) - begin < 20 * 1_000
    finally:
        tracemalloc.stop()
