"""What a report shows, against closed forms, independent libraries and the run itself."""

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.signal

from bmd_rths_core.analysis.numerical_motion import numerical_motion, stability_indicator
from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.analysis.supervised_peaks import largest_increment, largest_tracking_error
from bmd_rths_core.analysis.whole_samples import filled, strong_motion
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.build import make_numerical_substructure
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.report.document import Paragraph
from bmd_rths_core.report.html import page_of
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.run_report import run_report
from bmd_rths_core.report.sections import (
    SECTIONS,
    energy,
    forces,
    frequencies,
    hysteresis,
    responses,
    tracking,
    transfer,
)
from bmd_rths_core.report.sections.comparison import MOST_CURVES, comparisons
from bmd_rths_core.report.sections.energy import energy_history
from bmd_rths_core.report.sections.frequencies import table_frequencies
from bmd_rths_core.report.sections.hysteresis import specimen_loops, twice_integrated
from bmd_rths_core.report.sections.tracking import delay_over_time
from tests.conftest import SERVO_TABLE

DT = 0.005
THREE_STORIES = {
    "numerical_substructure__masses": [4000.0, 4000.0, 4000.0],
    "numerical_substructure__stiffnesses": [6e7, 6e7, 6e7],
    "numerical_substructure__damping_coefficients": [2e4, 2e4, 2e4],
    **SERVO_TABLE,
}
YIELDING = {
    "nonlinear__story_model": "bilinear",
    "nonlinear__integration": "cr",
    "nonlinear__yield_drifts": [1e-4],
}


def simulated(duration=8.0, **changes):
    """Return loop and record of a run."""
    config = Config().changed(ground_motion__duration=duration, **changes)
    loop = RthsLoop(config, select_ground_motion(config.ground_motion, DT))
    return loop, loop.run(), config


@pytest.mark.parametrize("changes", [{}, THREE_STORIES, YIELDING], ids=["one story", "three stories", "yielding"])
def test_numerical_motion_computed_again_is_that_of_the_run(changes):
    loop, record, config = simulated(**changes)
    motion = numerical_motion(record, config)
    assert motion.deviation_percent < 1e-9
    indicator = stability_indicator(motion, config)
    assert indicator.max() == pytest.approx(loop.stability_indicator.largest, rel=1e-6)
    stage = make_numerical_substructure(config)
    fed_back = np.append(0.0, record.corrected_force[:-1])
    displacements = []
    for inputs in zip(record.ground_acceleration, fed_back, strict=True):
        stage.step(*inputs)
        displacements.append(stage.displacements.copy())
    assert np.allclose(motion.displacements, displacements, rtol=0.0, atol=1e-9 * np.abs(displacements).max())


def test_numerical_motion_is_that_of_an_independent_simulation():
    _, record, config = simulated(**THREE_STORIES)
    motion = numerical_motion(record, config)
    building = config.numerical_substructure.building()
    a, b, c = building.relative_motion()
    on_roof = np.zeros((6, 1))
    on_roof[-1] = 1.0 / building.masses[-1]
    outputs = np.vstack((np.eye(6), c))
    system = scipy.signal.StateSpace(a, np.hstack((b, on_roof)), outputs, np.zeros((9, 2)))
    inputs = np.column_stack((record.ground_acceleration, record.required_force))
    _, expected, _ = scipy.signal.lsim(system, inputs, record.time)
    expected[:, 8] += record.required_force / building.masses[-1]
    for name, columns in (("displacements", slice(3)), ("velocities", slice(3, 6)), ("accelerations", slice(6, 9))):
        scale = np.abs(expected[:, columns]).max()
        assert np.allclose(getattr(motion, name), expected[:, columns], rtol=0.0, atol=1e-9 * scale), name


@pytest.mark.parametrize("changes", [{}, THREE_STORIES, YIELDING], ids=["one story", "three stories", "yielding"])
def test_energy_balance_closes(changes):
    _, record, config = simulated(**changes)
    found = energy_history(numerical_motion(record, config), config)
    brought = found.ground_input + found.interface
    kept = found.kinetic + found.springs + found.dampers
    assert np.abs(brought - kept).max() < 0.02 * np.abs(found.ground_input).max()
    assert np.all(np.diff(found.dampers) >= 0.0)


@pytest.mark.slow
def test_ductility_is_peak_drift_over_yield_drift():
    _, record, config = simulated(**YIELDING)
    (ductility,) = analysed(record).ductility
    assert ductility == pytest.approx(np.abs(numerical_motion(record, config).displacements).max() / 1e-4)
    assert ductility > 2.0
    _, elastic, _ = simulated(2.0)
    assert analysed(elastic).ductility is None


def test_gaps_are_bridged_and_told():
    _, record, config = simulated()
    gap = {
        name: np.where(np.isin(np.arange(record.steps), [700, 900, 901]), np.nan, getattr(record, name))
        for name in ("ground_acceleration", "required_force")
    }
    deviation = numerical_motion(dataclasses.replace(record, **gap), config).deviation_percent
    assert 1e-6 < deviation < 20.0
    assert filled(np.array([np.nan, 1.0, np.nan, 3.0, np.nan])).tolist() == [1.0, 1.0, 2.0, 3.0, 3.0]
    assert not filled(np.full(3, np.nan)).any()


def test_twofold_integration_returns_a_known_displacement_and_half_of_it_at_the_corner():
    time, omega, width = np.arange(8000) * DT, 2.0 * np.pi * 2.0, 4.0
    slope = -2.0 * (time - 20.0) / width**2 + 1j * omega
    packet = np.exp(-(((time - 20.0) / width) ** 2) + 1j * omega * time)
    displacement, acceleration = packet.imag, ((slope**2 - 2.0 / width**2) * packet).imag
    found = twice_integrated(acceleration, DT, 0.05 * omega)
    assert np.allclose(found, displacement, rtol=0.0, atol=1e-4)
    assert np.abs(twice_integrated(acceleration, DT, omega)).max() == pytest.approx(0.5, abs=5e-3)


@pytest.mark.slow
def test_stories_of_a_noise_free_specimen_have_their_configured_stiffness():
    quiet = {"simulated_table__acceleration_noise": 0.0, "simulated_table__shear_noise": 0.0} | {
        f"simulated_table__{name}_noise": 0.0 for name in ("displacement", "force")
    }
    _, record, config = simulated(20.0, simulated_table__dynamics="perfect", run__scheme="uc", **quiet)
    loops = specimen_loops(record, config).stories
    assert [story.name for story in loops] == ["specimen story 1", "specimen story 2"]
    for story, stiffness in zip(loops, config.specimen.stiffnesses, strict=True):
        slope = float(story.drift @ story.force / (story.drift @ story.drift))
        assert slope == pytest.approx(stiffness, rel=0.02)


def test_delay_over_time_follows_a_delay_that_changes():
    noise = scipy.signal.lfilter(*scipy.signal.butter(4, 10.0, fs=1.0 / DT), np.random.default_rng(0).normal(size=4000))
    achieved = np.concatenate((np.roll(noise, 2)[:2000], np.roll(noise, 4)[2000:]))
    achieved[3200:] = noise[3200:] = 0.0
    times, delays = delay_over_time(noise, achieved, DT)
    assert delays[times < 8.9] == pytest.approx(10.0, abs=0.2)
    assert delays[(times > 11.1) & (times < 15.0)] == pytest.approx(20.0, abs=0.2)
    assert times.max() < 17.0  # then it is quiet
    assert all(len(values) == 0 for values in delay_over_time(noise[:100], achieved[:100], DT))


def test_frequency_response_of_a_delayed_table_has_its_phase():
    _, record, _ = simulated()
    desired = np.random.default_rng(0).normal(size=record.steps)
    late = dataclasses.replace(record, desired_acceleration=desired, table_acceleration=0.5 * np.roll(desired, 1))
    found = table_frequencies(late).response  # read one step later, hence two steps late
    assert np.abs(found.response) == pytest.approx(0.5, rel=0.1)
    expected = np.exp(-1j * found.frequencies * 2.0 * DT)
    assert np.abs(np.angle(found.response / expected)).max() < 0.2
    assert found.coherence.min() > 0.9


def test_strong_motion_of_a_constant_acceleration_leaves_out_both_ends():
    begin, end = strong_motion(np.append(np.ones(2000), np.zeros(500)), DT)
    assert (begin, end) == pytest.approx((0.5, 9.5), abs=2.0 * DT)
    assert strong_motion(np.zeros(11), DT) == pytest.approx((0.0, 0.05))
    assert strong_motion(np.zeros(0), DT) == (0.0, 0.0)


FIGURES = {
    "responses": responses.figure,
    "tracking": tracking.figure,
    "frequencies": frequencies.figure,
    "transfer": transfer.figure,
    "forces": forces.figure,
    "numerical_stories": hysteresis.numerical_figure,
    "specimen_stories": hysteresis.specimen_figure,
    "energy": energy.figure,
}


def hostile_records(record):
    """Yield what a report has to survive, and the parts that it can still show."""
    everything = set(FIGURES)
    histories = {"responses", "tracking", "forces", "numerical_stories", "energy"}

    def changed(change):
        return dataclasses.replace(record, **{name: change(signal) for name, signal in record.signals().items()})

    for steps in (0, 1, 2):
        yield f"{steps} steps", changed(lambda signal, n=steps: signal[:n]), set()
    for steps in (3, 10):
        yield f"{steps} steps", changed(lambda signal, n=steps: signal[:n]), histories
    yield "zero", changed(np.zeros_like), histories | {"specimen_stories"}
    yield "nothing recorded", changed(lambda s: np.full_like(s, np.nan)), {"responses", "numerical_stories", "energy"}
    rng = np.random.default_rng(0)
    yield "gaps", changed(lambda signal: np.where(rng.random(signal.shape) < 0.05, np.nan, signal)), everything
    no_floors = dataclasses.replace(record, floor_accelerations=np.zeros((record.steps, 0)))
    yield "no floors", no_floors, histories | {"frequencies"}


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("changes", [{}, YIELDING], ids=["linear", "yielding"])
def test_whatever_is_in_a_record_there_is_a_report_that_says_what_cannot_be_shown(changes):
    _, record, _ = simulated(**changes)
    for name, hostile, expected in hostile_records(record):
        run = ReportedRun(analysed(hostile), "no clock")
        parts = {part: figure(run) for part, figure in FIGURES.items()}
        assert {part for part, data in parts.items() if not isinstance(data, str)} == expected, name
        assert all(reason for reason in parts.values()), name
        assert len(run_report(run).sections) == len(SECTIONS), name


@pytest.mark.slow
def test_runs_with_the_same_ground_and_building_are_laid_over_each_other():
    motion = GroundMotion("pulse", DT, np.sin(np.arange(1000) / 20.0), "test", "0" * 64)
    schemes = ["uc", "fc", "plc", "plc_fc", "plc_fc"]
    records = [RthsLoop(Config().changed(run__scheme=scheme), motion).run() for scheme in schemes]
    other_building = RthsLoop(Config().changed(specimen__masses=[700.0, 800.0]), motion).run()
    too_short = dataclasses.replace(records[0], **{n: s[:2] for n, s in records[0].signals().items()})
    reports = [ReportedRun(analysed(record), "no clock") for record in (too_short, *records, other_building)]
    (group,) = comparisons(reports)
    assert [run.label for run in group.runs] == ["run 2: uc", "run 3: fc", "run 4: plc", "run 5: plc_fc"]
    assert (len(group.runs), group.left_out) == (MOST_CURVES, 1)
    assert 0.0 <= group.window[0] < group.window[1] <= 5.0


@pytest.mark.parametrize("limit", ["increment", "tracking"])
def test_largest_increment_and_tracking_error_are_what_the_supervisor_found(limit):
    value = {"increment": 0.4, "tracking": 0.3}[limit]
    _, record, config = simulated(**{f"safety__{limit}_limit": value})
    assert record.outcome == "limit"
    largest = {
        "increment": largest_increment(record),
        "tracking": largest_tracking_error(record, config.safety),
    }
    told = float(re.search(r": [a-z ]+ (-?[\d.]+), allowed", record.reason).group(1))
    assert largest[limit] == pytest.approx(abs(told), rel=1e-5)


def test_largest_increment_and_tracking_error_of_an_empty_record_are_unknown():
    _, record, config = simulated(1.0)
    for short in (0, 1):
        cut = {name: signal[:short] for name, signal in record.signals().items()}
        assert np.isfinite(largest_increment(dataclasses.replace(record, **cut))) == bool(short)
    nothing = dataclasses.replace(record, applied_command=np.full(record.steps, np.nan))
    assert np.isnan(largest_tracking_error(nothing, config.safety))
    assert largest_increment(nothing) == pytest.approx(np.abs(np.diff(record.command, prepend=0.0)).max())


def test_every_section_is_in_the_registry_and_has_a_title_of_its_own():
    folder = Path(energy.__file__).parent
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__", "comparison"}
    assert {section.__name__.rpartition(".")[2] for section in SECTIONS} == modules
    assert len({section.TITLE for section in SECTIONS}) == len(SECTIONS)


@pytest.mark.slow
def test_a_further_section_is_a_module_and_a_line(monkeypatch):
    planted = SimpleNamespace(TITLE="Planted", blocks=lambda run: [Paragraph(f"of {run.record.steps} steps")])
    monkeypatch.setattr("bmd_rths_core.report.run_report.SECTIONS", (*SECTIONS, planted))
    _, record, _ = simulated(1.0)
    page = page_of(run_report(ReportedRun(analysed(record), "no clock")))
    assert page.index("<h2>Provenance</h2>") < page.index("<h2>Planted</h2>") < page.index("<p>of 201 steps</p>")
