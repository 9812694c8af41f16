"""Measures of ground motions against closed forms, and the catalogue of a folder."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import scipy.signal
from scipy.integrate import cumulative_trapezoid, quad

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import GroundMotion, read_ground_motion
from bmd_rths_core.ground_motion.catalogue import catalogue, record_files
from bmd_rths_core.ground_motion.intensity import (
    arias_intensity,
    dominant_frequency,
    intensity,
    peak_velocity,
    significant_duration,
)
from tests.core.record_samples import COMPONENTS, SAMPLES, knet

G = 9.80665


def motion_of(acceleration: np.ndarray, time_step: float) -> GroundMotion:
    return GroundMotion("made up", time_step, acceleration, "test", "")


def sine(amplitude: float, frequency: float, duration: float, time_step: float = 0.001) -> GroundMotion:
    time = np.arange(round(duration / time_step) + 1) * time_step
    return motion_of(amplitude * np.sin(2 * np.pi * frequency * time), time_step)


@pytest.mark.parametrize(("amplitude", "frequency"), [(3.0, 1.0), (0.5, 2.5)])
def test_sine(amplitude: float, frequency: float) -> None:
    motion = sine(amplitude, frequency, duration=40.0)
    measures = intensity(motion)
    assert measures.peak_acceleration == pytest.approx(amplitude, rel=1e-4)
    # from rest: v = A / ω (1 - cos ωt)
    assert measures.peak_velocity == pytest.approx(amplitude / (np.pi * frequency), rel=1e-4)
    assert measures.arias_intensity == pytest.approx(math.pi / (2 * G) * amplitude**2 / 2 * 40.0, rel=1e-9)
    # t - sin(2ωt) / 2ω grows like t, with equality at every half period, as are 5 % and 95 % of 40 s
    assert measures.significant_duration == pytest.approx(0.9 * 40.0, rel=1e-9)
    assert measures.dominant_frequency == pytest.approx(frequency, abs=0.5 / 80)


def test_rectangular_pulse() -> None:
    # 2 m/s² for 3 s, between two ramps of one step
    motion = motion_of(np.repeat([0.0, 2.0, 0.0], [100, 301, 100]), 0.01)
    assert peak_velocity(motion) == pytest.approx(2.0 * 3.01, rel=1e-12)
    assert arias_intensity(motion) == pytest.approx(math.pi / (2 * G) * 4.0 * 3.01, rel=1e-12)
    assert significant_duration(motion) == pytest.approx(0.9 * 3.01, rel=1e-12)


def test_decaying_motion_against_quadrature() -> None:
    def square(t: float) -> float:
        return math.exp(-t) * math.sin(12.0 * t) ** 2

    time = np.arange(0, 30_001) * 1e-3
    motion = motion_of(np.exp(-time / 2) * np.sin(12.0 * time), 1e-3)
    total = quad(square, 0.0, 30.0, limit=500)[0]
    assert arias_intensity(motion) == pytest.approx(math.pi / (2 * G) * total, rel=1e-5)
    # ∫ e^-t sin² 12t dt up to t = 1/2 - e^-t (1/2 - (cos 24t - 24 sin 24t) / 1154) - 1/1154
    grown = 0.5 - 1 / 1154 - np.exp(-time) * (0.5 - (np.cos(24 * time) - 24 * np.sin(24 * time)) / 1154)
    expected = np.interp(0.95 * total, grown, time) - np.interp(0.05 * total, grown, time)
    assert significant_duration(motion) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("frequency", [0.5, 1.37, 8.0])
@pytest.mark.parametrize("duration", [4.0, 10.0, 95.0])
def test_dominant_frequency_of_a_sine_in_noise(frequency: float, duration: float) -> None:
    clean = sine(1.0, frequency, duration, time_step=0.005)
    noise = np.random.default_rng(1).normal(0.0, 0.3, clean.steps)
    motion = motion_of(5.0 + clean.acceleration + noise, 0.005)
    # half of what a segment resolves
    assert dominant_frequency(motion) == pytest.approx(frequency, abs=0.5 / min(duration, 10.0))


@pytest.mark.parametrize("steps", [2, 3, 150, 999, 1000, 1001, 5000])
def test_measures_are_those_of_scipy(steps: int) -> None:
    acceleration = np.random.default_rng(steps).normal(0.1, 1.0, steps)
    motion = motion_of(acceleration, 0.01)
    length = min(1000, steps)
    frequency, density = scipy.signal.welch(acceleration, 100.0, nperseg=length, nfft=8 * length)
    found = np.argmin(np.abs(frequency - dominant_frequency(motion)))
    assert dominant_frequency(motion) == pytest.approx(frequency[found], rel=1e-12)
    assert density[found] == pytest.approx(density.max(), rel=1e-12)  # of two samples all frequencies have the same
    velocity = cumulative_trapezoid(acceleration, dx=0.01, initial=0.0)
    assert peak_velocity(motion) == pytest.approx(np.max(np.abs(velocity)), rel=1e-12)


def test_measures_scale_with_the_acceleration() -> None:
    motion = read_ground_motion("el_centro_1940_ns")
    one, three = intensity(motion), intensity(motion_of(3.0 * motion.acceleration, motion.time_step))
    assert three.peak_velocity == pytest.approx(3.0 * one.peak_velocity, rel=1e-12)
    assert three.arias_intensity == pytest.approx(9.0 * one.arias_intensity, rel=1e-12)
    assert three.significant_duration == pytest.approx(one.significant_duration, rel=1e-9)
    assert three.dominant_frequency == one.dominant_frequency


def test_el_centro_has_the_duration_of_the_literature() -> None:
    # Trifunac and Brady 1975 and later catalogues: about 24 s for El Centro 1940 NS
    assert intensity(read_ground_motion("el_centro_1940_ns")).significant_duration == pytest.approx(24.0, abs=0.5)


@pytest.mark.parametrize("acceleration", [[0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0], [1e300, -1e300, 1e300], [1e-300, 0.0]])
@pytest.mark.parametrize("time_step", [1e-300, 0.01, 1e6])
@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning", "ignore:invalid value:RuntimeWarning")
def test_odd_motions_are_measured(acceleration: list[float], time_step: float) -> None:
    measures = intensity(motion_of(np.array(acceleration), time_step))
    assert 0.0 <= measures.significant_duration <= (len(acceleration) - 1) * time_step
    assert 0.0 <= measures.dominant_frequency <= 0.5 / time_step


# ------------------------------------------------------------------------------------------------------ the catalogue


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "event").mkdir()
    (tmp_path / ".hidden").mkdir()
    (tmp_path / ".hidden" / "record").write_bytes(knet())
    (tmp_path / "event" / "a.json").write_bytes(SAMPLES["SimCenter JSON"].content)
    (tmp_path / "event" / "b.NS").write_bytes(knet())
    (tmp_path / "event" / "c.AT2").write_text("no header\n")
    (tmp_path / "event" / "d.v2a").write_bytes(SAMPLES["GeoNet V2A"].content[:2000])
    (tmp_path / "INDEX.csv").write_text("file,dt\na,1\nb,2\n")
    (tmp_path / "README.md").write_text("Records\n")
    return tmp_path


def problem_of(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        catalogue(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def test_files_are_found_in_order_and_hidden_ones_passed_over(folder: Path) -> None:
    names = ["INDEX.csv", "README.md", "event/a.json", "event/b.NS", "event/c.AT2", "event/d.v2a"]
    assert [path.relative_to(folder).as_posix() for path in record_files(folder)] == names


def test_catalogue_measures_every_component(folder: Path) -> None:
    (entry,) = catalogue(folder / "event" / "b.NS")
    assert (entry.format, entry.component, entry.states_unit) == ("K-NET", "N-S", True)
    assert entry.intensity == intensity(read_ground_motion(folder / "event" / "b.NS"))
    without_unit = catalogue(folder / "event" / "a.json")
    assert [(entry.component, entry.states_unit) for entry in without_unit] == [(axis, False) for axis in "xyz"]
    np.testing.assert_array_equal(without_unit[1].motion.acceleration, COMPONENTS[1])


@pytest.mark.parametrize(
    ("file", "problem"),
    [
        ("INDEX.csv", "not a record: line 1: 0 time columns in 'file,dt'"),
        ("README.md", "not a ground motion in a format that is read: PEER AT2, CSV, K-NET"),
        ("event/c.AT2", "not a record: no header line with NPTS and DT"),
        ("event/d.v2a", "line 36: 0 lines 'Component ...'"),
    ],
)
def test_catalogue_tells_what_is_wrong_with_the_rest(folder: Path, file: str, problem: str) -> None:
    assert problem_of(folder / file).startswith(problem)


def test_one_file_is_a_catalogue_too(folder: Path) -> None:
    assert record_files(folder / "event" / "b.NS") == [folder / "event" / "b.NS"]


@pytest.mark.parametrize("name", ["absent", "a\0b", "x" * 300])
def test_absent_folder_is_refused(folder: Path, name: str) -> None:
    with pytest.raises(InputError) as caught:
        record_files(folder / name)
    assert len(str(caught.value).splitlines()) == 1
