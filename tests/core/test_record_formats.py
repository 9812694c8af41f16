"""Readers of the agencies' formats: samples made from their documentation, and every kind of damage."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import (
    GroundMotion,
    read_cosmos,
    read_csmip,
    read_cwa,
    read_esm,
    read_geonet,
    read_ground_motion,
    read_jma,
    read_knet,
    read_mat,
    read_simcenter,
)
from bmd_rths_core.ground_motion.config import GroundMotionConfig, select_ground_motion
from bmd_rths_core.ground_motion.library import FORMATS
from tests.core.record_samples import COMPONENTS, SAMPLES, TIME, TIME_STEP, cosmos, csmip, knet, mat


@pytest.fixture
def record(tmp_path: Path) -> Callable[[bytes], Path]:
    """Write a file whose name says nothing about its format."""

    def write(content: bytes) -> Path:
        path = tmp_path / "record"
        path.write_bytes(content)
        return path

    return write


def refusal(path: Path, component: str = "only", unit: str = "from_file") -> str:
    """Return the message a file is refused with, behind its path: one line."""
    with pytest.raises(InputError) as caught:
        read_ground_motion(path, component, unit)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


# ------------------------------------------------------------------------------------------------------------ samples


@pytest.mark.parametrize("name", SAMPLES)
def test_every_component_is_read_from_a_file_of_any_name(record, name: str) -> None:
    sample = SAMPLES[name]
    path = record(sample.content)
    for component, expected in zip(sample.names, COMPONENTS, strict=False):
        motion = read_ground_motion(path, component, sample.unit)
        assert motion.time_step == pytest.approx(TIME_STEP, rel=1e-7)
        np.testing.assert_allclose(motion.acceleration, expected / 100.0, atol=1e-7 if name == "MAT" else 1e-14)
        assert motion.source == str(path)


@pytest.mark.parametrize("name", SAMPLES)
def test_every_reader_reads_its_format(record, name: str) -> None:
    sample = SAMPLES[name]
    path, last = record(sample.content), sample.names[-1]
    readers: dict[str, Callable[[], GroundMotion]] = {
        "K-NET": lambda: read_knet(path),
        "COSMOS V2": lambda: read_cosmos(path, last),
        "CSMIP V2": lambda: read_csmip(path, last),
        "GeoNet V2A": lambda: read_geonet(path, last),
        "ESM": lambda: read_esm(path),
        "CWA": lambda: read_cwa(path, last),
        "JMA CSV": lambda: read_jma(path, last),
        "SimCenter JSON": lambda: read_simcenter(path, last, "cm/s2"),
        "MAT": lambda: read_mat(path, "cm/s2", last),
    }
    expected = read_ground_motion(path, last, sample.unit).acceleration
    np.testing.assert_array_equal(readers[name]().acceleration, expected)


@pytest.mark.parametrize("name", SAMPLES)
def test_several_components_must_be_told_apart(record, name: str) -> None:
    sample = SAMPLES[name]
    path = record(sample.content)
    listed = ", ".join(repr(component) for component in sample.names)
    allowed = f"ground_motion.component (--component) must be one of {listed}"
    assert refusal(path, "sideways") == f"0 components 'sideways'; {allowed}"
    if sample.needs_component:
        assert refusal(path) == f"{len(sample.names)} components; {allowed}"
        assert read_ground_motion(path, sample.names[0].lower(), sample.unit).name.startswith("record_")
    else:
        assert read_ground_motion(path).name == "record"


@pytest.mark.parametrize("name", SAMPLES)
def test_unit_is_never_guessed(record, name: str) -> None:
    sample = SAMPLES[name]
    path, component = record(sample.content), sample.names[0]
    if sample.unit == "from_file":
        assert refusal(path, component, "g") == "the file states its unit; ground_motion.unit is 'g', not 'from_file'"
    else:
        message = "the file states no unit; ground_motion.unit must give it: g, m/s2, cm/s2 or gal (--unit)"
        assert refusal(path, component) == message
        in_gal = read_ground_motion(path, component, "gal").acceleration
        np.testing.assert_allclose(in_gal, COMPONENTS[0] / 100.0, rtol=1e-12, atol=1e-12)
        assert "is no ground acceleration; at most 100 m/s² is read" in refusal(path, component, "g")


def test_component_of_a_file_that_names_none_is_refused(record) -> None:
    path = record(b"time_s,acceleration_g\n0,0\n0.1,1\n")
    assert refusal(path, "x") == "one component without a name; ground_motion.component is 'x', not 'only'"
    assert refusal(path, unit="gal").startswith("the file states its unit")


def test_component_and_unit_reach_the_loop(record) -> None:
    path = record(SAMPLES["SimCenter JSON"].content)
    config = GroundMotionConfig(record=str(path), component="y", unit="gal", peak_acceleration=0.0)
    motion = select_ground_motion(config, TIME_STEP)
    np.testing.assert_allclose(motion.acceleration, COMPONENTS[1] / 100.0, rtol=1e-14)
    assert motion.name == "record_y"
    with pytest.raises(InputError, match=r"^ground_motion\.unit: 'furlong' is not allowed; one of from_file, g, m/s2"):
        GroundMotionConfig(unit="furlong")


def test_offset_of_knet_is_removed_and_nothing_else(record) -> None:
    content = knet().replace(b"Dir.              N-S", b"Dir.              5  ")
    assert read_ground_motion(record(content), "E-W surface").peak == pytest.approx(1.0, rel=1e-14)


def test_channels_of_one_direction_are_told_apart_by_their_place(record) -> None:
    path = record(csmip(("90 DEG", "UP", "90 DEG")))
    names = "'90 DEG (1)', 'UP', '90 DEG (3)'"
    assert refusal(path, "90 DEG").endswith(f"must be one of {names}")
    motion = read_ground_motion(path, "90 deg (3)")
    np.testing.assert_allclose(motion.acceleration, COMPONENTS[2] / 100.0, rtol=1e-14)
    assert motion.name == "record_90_DEG_3"


def test_later_spelling_of_csmip_is_read(record) -> None:
    later = csmip().replace(b"  .020 SEC.  (UNITS: CM/SEC/SEC)", b"  .020 sec, in cm/sec2. (8f10.3)")
    assert read_ground_motion(record(later), "UP").peak == pytest.approx(2.0, rel=1e-14)


def test_full_columns_need_no_blank_between_them(record) -> None:
    # 000123.456 and -00012.345 fill the ten characters of F10.3
    content = csmip().replace(b"     0.000    25.900", b"000123.456-00012.345")
    np.testing.assert_allclose(read_ground_motion(record(content), "90 DEG").acceleration[:2], [1.23456, -0.12345])


# ----------------------------------------------------------------------------------------------------------- problems


WRONG = {
    "K-NET rate": ("K-NET", b"50Hz", b"fast", "line 3: 'fast' is not a finite number"),
    "K-NET rate of zero": ("K-NET", b"50Hz", b"0Hz", "line 3: Sampling Freq(Hz) 0Hz; a number > 0 is required"),
    "K-NET scale": ("K-NET", b"2000(gal)/20000", b"2000/20000", "line 6: scale factor '2000/20000'; '3920(gal)/"),
    "K-NET scale of zero": ("K-NET", b"/20000", b"/0", "line 6: scale factor '2000(gal)/0'; two numbers > 0"),
    "K-NET length": ("K-NET", b"0.48", b"0.5", "24 values up to line 11, but duration times sampling frequency is 25"),
    "K-NET header": ("K-NET", b"Duration", b"Dvration", "no header line 'Duration Time(s)' before line 9"),
    "ESM velocity": ("ESM", b"ACCELERATION", b"VELOCITY", "line 11: a velocity, by DATA_TYPE 'VELOCITY'; ACCELERATION"),
    "ESM unit": ("ESM", b": cm/s^2", b": cm/s", "line 7: a velocity, in 'cm/s'; an acceleration in g, m/s², cm/s²"),
    "ESM count": ("ESM", b"NDATA: 24", b"NDATA: 25", "24 values up to line 35, but NDATA is 25"),
    "CWA sense": ("CWA", b"N(+)", b"N(-)", "line 8: columns 'Time U(+); N(-); E(+)'; 'Time U(+); N(+); E(+)' is"),
    "CWA time": ("CWA", b"     0.040", b"     0.050", "line 12: time 0.05 s; 0.04 s is required by the sample rate"),
    "CWA column": ("CWA", b"     0.020 ", b"     0.020 1 ", "line 11: 5 numbers in '0.020 1 "),
    "CWA length": ("CWA", b"0.48", b"120", "24 values up to line 33, but length times sample rate is 6000"),
    "JMA unit": ("JMA CSV", b"gal(cm/s/s)", b"kine", "line 4: unit 'kine'; an acceleration in g, m/s², cm/s² or gal"),
    "JMA columns": ("JMA CSV", b"NS,EW,UD", b"0.1,0.2,0.3", "line 5: columns '0.1,0.2,0.3'; 'NS,EW,UD' is required"),
    "JMA row": ("JMA CSV", b"0.000,0.000,0.000", b"0.000,0.000", "line 6: 2 numbers in '0.000,0.000'; 3 are required"),
    "GeoNet component": ("GeoNet V2A", b"Component S80E", b"Axis S80E", "line 36: 0 lines 'Component ...' in 16 lines"),
    "GeoNet unit": ("GeoNet V2A", b"mm/s/s", b"m/s/s", "line 1: no line 'Acceleration: peak ... mm/s/s' in 16 lines"),
    "GeoNet points": ("GeoNet V2A", b"      24      24", b"       1      24", "line 20: [1, 24, 24] points of"),
    "GeoNet separator": ("GeoNet V2A", b"Component N10E", b"\nComponent N10E", "line 17: 'Displacement:"),
    "CSMIP unit": ("CSMIP V2", b"CM/SEC/SEC", b"COUNTS", "line 11: unit 'COUNTS'; an acceleration in g"),
    "CSMIP count": ("CSMIP V2", b"  24 POINTS OF ACCEL", b"  20 POINTS OF ACCEL", "line 14: '-86.600 "),
    "CSMIP end": ("CSMIP V2", b"CHANNEL  2", b"", "line 34: the channel is cut off: 'END OF DATA FOR CHANNEL' is"),
    "CSMIP name": ("CSMIP V2", b"CHAN ", b"", "line 11: no line 'CHAN  1:  90 DEG' above the values"),
    "COSMOS raw": ("COSMOS V2", b"Corrected", b"Raw", "line 1: an uncorrected record, 'Raw acceleration"),
    "COSMOS unit": ("COSMOS V2", b"cm/sec2(04)", b"counts(50)", "line 48: unit 'counts(50)'; an acceleration in"),
    "COSMOS time step": ("COSMOS V2", b"20.000000", b" 0.000000", "line 48: time step 0 s in the header above; a"),
    "COSMOS count": ("COSMOS V2", b"  24 acc", b"  25 acc", "line 52: 'End-of-data for ChanHNN acceleration'; 1"),
    "COSMOS format": ("COSMOS V2", b"(8F10.3)", b"(0F10.3)", "line 48: '24 acceleration pts, approx    0 secs, uni"),
    "JSON syntax": ("SimCenter JSON", b'"name"', b"name", "line 4: no JSON: Expecting property name"),
    "JSON NaN": ("SimCenter JSON", b'"dT": 0.02', b'"dT": NaN', "dT is 'nan'; a finite number is required"),
    "JSON time step": ("SimCenter JSON", b'"dT"', b'"dt"', "no dT; the time step in s is required"),
    "JSON text": ("SimCenter JSON", b"-100.0", b'"low"', "data_x[18] is 'low'; a finite number is required"),
    "JSON list": ("SimCenter JSON", b'"data_z"', b'"data_y": 3, "data_z"', "data_y is no list; a list of numbers is"),
    "MAT 7.3": ("MAT", b"MATLAB 5.0", b"MATLAB 7.3", "a MATLAB file of version 7.3; version 7 is required: save it"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_named_with_its_line(record, case: str) -> None:
    name, old, new, problem = WRONG[case]
    sample = SAMPLES[name]
    assert old in sample.content
    changed = sample.content.replace(old, new) if case == "CSMIP name" else sample.content.replace(old, new, 1)
    assert refusal(record(changed), sample.names[0], sample.unit).startswith(problem)


def test_shifted_line_is_refused_because_a_column_could_cut_a_number(record) -> None:
    content = re.sub(rb"\n {5}0\.000", b"\n0.000", csmip(), count=1)
    message = refusal(record(content), "90 DEG")
    assert re.match(r"line 12: '0\.000 .*; 8 numbers in columns of 10 characters are required$", message)


def test_cosmos_without_seed_code_has_the_direction_of_the_channel(record) -> None:
    line = b"Sta Chan   1: 360 deg (Rcrdr Chan  1) Location:Ground\n"
    content = re.sub(rb"\|<SCNL>.*\n", b"| no code\n", cosmos()).replace(b"A made-up record\n", line, 1)
    assert refusal(record(content)).endswith("must be one of '360 deg', '(2)', '(3)'")


def test_velocities_in_cosmos_are_refused(record) -> None:
    content = cosmos("velocity").replace(b"Corrected velocity", b"Corrected acceleration")
    assert "acceleration pts are required" in refusal(record(content))


@pytest.mark.parametrize("name", [name for name in SAMPLES if name not in ("MAT", "JMA CSV")])
@pytest.mark.parametrize("share", [0.5, 0.9, "last line"])
def test_cut_file_is_refused(record, name: str, share: float | str) -> None:
    sample = SAMPLES[name]
    lines = sample.content.rstrip().splitlines(keepends=True)
    cut = len(lines) - 1 if share == "last line" else math.ceil(len(lines) * float(share))
    message = refusal(record(b"".join(lines[:cut])), sample.names[0], sample.unit)
    assert re.search(r"\bline \d+\b", message)


@pytest.mark.parametrize(("name", "lines"), [("CSMIP V2", 26), ("COSMOS V2", 70)])
def test_file_cut_in_the_header_of_a_component_is_refused(record, name: str, lines: int) -> None:
    # the components before are whole, but one that is missing would not be missed
    start = b"".join(SAMPLES[name].content.splitlines(keepends=True)[:lines])
    assert refusal(record(start), SAMPLES[name].names[0]).startswith(f"line {lines}: the file is cut off: 'E")


def test_end_of_a_dos_file_is_passed_over(record) -> None:
    assert read_ground_motion(record(knet() + b"\x1a")).steps == len(TIME)


@pytest.mark.parametrize("blank", [b"\x1c", b"\x1d", b"\x1e", b"\x1f"])
def test_control_character_that_is_a_blank_is_one(record, blank: bytes) -> None:
    """Not to `float`, which found it in front of a number."""
    sample = SAMPLES["JMA CSV"]
    (name, *_) = sample.names
    lines = sample.content.split(b"\n")
    place = max(i for i, line in enumerate(lines) if line.strip())
    lines[place] = blank + lines[place]
    read = read_ground_motion(record(b"\n".join(lines)), name, sample.unit)
    expected = read_ground_motion(record(sample.content), name, sample.unit)
    np.testing.assert_array_equal(read.acceleration, expected.acceleration)


def test_text_without_a_header_is_refused(record) -> None:
    message = refusal(record(b"-.6403182E-02\n-.6028715E-02\n.5304162E-03\n"))
    assert message.startswith("the file states no unit and no time step; ground_motion.unit must give it")


@pytest.mark.parametrize(
    ("variables", "problem"),
    [
        ({"a": np.eye(3)}, "no array of time and acceleration (2 × N or N × 2) and no vector; variables: 'a 3×3'"),
        ({"a": np.vstack([TIME, TIME * 1j])}, "variable 'a' is complex or cannot be read; a real array is required"),
        ({"a": np.full((2, 24), math.nan)}, "variable 'a': point 1 is nan, nan; finite numbers are required"),
        ({"a": np.vstack([TIME + 1.0, TIME])}, "variable 'a': time of point 1 is 1 s; equal steps from 0 are required"),
        ({"a": np.vstack([TIME**2.0, TIME])}, "variable 'a': time of point 2 is 1 s; equal steps from 0 are required"),
        ({"a": np.vstack([0.0 * TIME, TIME])}, "variable 'a': time of point 1 is 0 s; equal steps from 0 are required"),
    ],
)  # fmt: skip
def test_wrong_arrays_are_refused(record, variables: dict[str, object], problem: str) -> None:
    assert refusal(record(mat(**variables)), unit="g") == problem


def test_file_larger_than_any_record_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "film.csv"
    with path.open("wb") as file:
        file.write(b"#")
        file.truncate(200_000_000)
    assert refusal(path) == "larger than 100 MB; no ground motion is"


# -------------------------------------------------------------------------------------------------------------- damage


def test_every_format_has_a_sample() -> None:
    assert {known.name for known in FORMATS} == {
        *SAMPLES,
        "PEER AT2",
        "CSV",
        "columns of numbers",
        "USGS SMC",
        "SAC",
        "miniSEED",
        "AFAD",
        "ASDF",
    }  # the last six are tested with the cases from elsewhere


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLES)
@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_damaged_bytes_are_read_or_refused_in_one_line(tmp_path: Path, name: str, data: st.DataObject) -> None:
    sample = SAMPLES[name]
    content = bytearray(sample.content)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content)))
        content[place : place + data.draw(st.integers(0, 30))] = data.draw(
            st.one_of(st.binary(max_size=4), st.sampled_from([b"9" * 40, b"-", b"1E308", b"1E-320", b"NaN", b"\n"]))
        )
    path = tmp_path / "damaged"
    path.write_bytes(content)
    for component in sample.names:
        motion = message = None
        try:
            motion = read_ground_motion(path, component, sample.unit)
        except InputError as error:
            message = str(error)
        assert message is None or len(message.splitlines()) == 1
        assert motion is None or (np.isfinite(motion.acceleration).all() and 0.0 < motion.time_step < math.inf)


@pytest.mark.parametrize("suffix", [suffix for known in FORMATS for suffix in known.suffixes])
@given(content=st.binary(max_size=200))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_arbitrary_bytes_are_refused_in_one_line(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"junk{suffix}"
    path.write_bytes(content)
    refusal(path)
