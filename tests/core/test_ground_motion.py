"""Readers of ground motions: every real record against its index, and every kind of bad file."""

from __future__ import annotations

import csv
import hashlib
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import (
    STANDARD_GRAVITY,
    GroundMotion,
    read_at2,
    read_ground_motion,
    shipped_records,
)
from tests.conftest import ground_motion_folder, needs

FOLDER = ground_motion_folder()
READ_SUFFIXES = (".at2", ".csv")

needs_records = needs(FOLDER)


def index_rows(index: str) -> list[dict[str, str]]:
    path = FOLDER / index
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


RECORDS = index_rows("INDEX.csv")
# the other rows are those of test_record_formats.py
FORMATS = [row for row in index_rows("formats/INDEX.csv") if row["file"].lower().endswith(READ_SUFFIXES)]
# What the files themselves do not state, as the index has it
UNITS = {"SimCenter JSON": "g", "MAT v5 (2xN: t, a)": "m/s2"}


def refusal(reference: str | Path) -> str:
    """Return the message a file is refused with: one line that names the file."""
    with pytest.raises(InputError) as caught:
        read_ground_motion(reference)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert str(reference) in message
    return message


# ---------------------------------------------------------------------------------------------------- real records


@needs_records
@pytest.mark.parametrize("row", RECORDS, ids=lambda row: f"{row['file']} {row['component']}")
def test_record_agrees_with_its_index(row: dict[str, str]) -> None:
    several = re.match(r"(\w+) \(of ", row["component"])
    component = several[1] if several else "only"
    motion = read_ground_motion(FOLDER / row["file"], component, UNITS.get(row["format"], "from_file"))

    assert motion.steps == int(row["npts"])
    assert motion.time_step == float(row["dt_s"])
    assert motion.peak / STANDARD_GRAVITY == pytest.approx(float(row["PGA_g"]), abs=0.5001e-4)
    # 0.7 of the last digit, because the index gives 3.1265 for the 3.12656 m/s² of elcentro_1940_ns.csv
    assert motion.peak == pytest.approx(float(row["PGA_m_s2"]), abs=0.7e-4)
    time_of_peak = np.argmax(np.abs(motion.acceleration)) * motion.time_step
    if row["file"] == "elcentro_1940_ns.csv":
        # The file has its peak on the line "2.04,-0.31882"; its index counts without the zero at time zero.
        time_of_peak -= motion.time_step
    assert time_of_peak == pytest.approx(float(row["t_PGA_s"]), abs=0.005001)
    assert motion.name == Path(row["file"]).stem + (f"_{component}" if several else "")
    assert motion.source == str(FOLDER / row["file"])
    assert motion.sha256 == hashlib.sha256((FOLDER / row["file"]).read_bytes()).hexdigest()


@needs_records
@pytest.mark.parametrize("row", FORMATS, ids=lambda row: row["file"])
def test_odd_header_agrees_with_its_index(row: dict[str, str]) -> None:
    motion = read_ground_motion(FOLDER / "formats" / row["file"])

    facts = dict(re.findall(r"(\w+)=([0-9.]+)", row["parse"].replace("max|a|", "PGA").replace(" = ", "=")))
    # elCentro.at2 has its time step in the prose of its header alone: "1559 points at equal spacing of 0.02 sec"
    assert motion.time_step == float(facts.get("dt", 0.02))
    assert motion.steps == int(facts.get("values") or facts["npts"])
    assert motion.peak / STANDARD_GRAVITY == pytest.approx(float(facts["PGA"]), abs=0.5001e-4)


@needs_records
def test_no_file_of_the_folder_is_left_out() -> None:
    present = {path.relative_to(FOLDER).as_posix() for path in FOLDER.rglob("*") if path.suffix.lower() == ".at2"}
    assert present <= {row["file"] for row in RECORDS} | {f"formats/{row['file']}" for row in FORMATS}
    assert len(present) >= 30


@needs_records
def test_fortran_exponents_give_the_numbers_of_the_original() -> None:
    original = read_at2(FOLDER / "Northridge" / "RSN1044_NORTHR_NWH090.AT2")
    derived = read_at2(FOLDER / "formats" / "DERIVED_fortranD_RSN1044_NORTHR_NWH090.AT2")
    np.testing.assert_array_equal(derived.acceleration, original.acceleration)


@needs_records
def test_prose_header_holds_the_shipped_record() -> None:
    # the same textbook record in two files; the CSV begins with one more point, zero at time zero
    prose = read_at2(FOLDER / "formats" / "elCentro.at2")
    shipped = read_ground_motion("el_centro_1940_ns")
    np.testing.assert_array_equal(prose.acceleration, shipped.acceleration[1:])


# -------------------------------------------------------------------------------------------------- shipped records


def test_el_centro_is_shipped() -> None:
    assert "el_centro_1940_ns" in shipped_records()
    motion = read_ground_motion("el_centro_1940_ns")
    assert (motion.name, motion.source) == ("el_centro_1940_ns", "shipped")
    assert (motion.steps, motion.time_step) == (1560, 0.02)
    assert motion.duration == pytest.approx(31.18, rel=1e-12)
    # textbooks (Chopra, Dynamics of Structures) give 0.319 g for this record
    assert motion.peak == pytest.approx(0.31882 * 9.80665, rel=1e-12)
    assert motion.sha256 == "2969b09a3203fd5f29996ebae60cfee501d8c044c7fb206801494f6353c2fccb"


@pytest.mark.parametrize("name", shipped_records())
def test_every_shipped_record_is_read_by_its_name(name: str) -> None:
    motion = read_ground_motion(name)
    assert motion.name == name
    assert motion.peak > 0.0


# ---------------------------------------------------------------------------------------------------- the motion


def test_motion_keeps_a_read_only_copy() -> None:
    points = np.array([0.0, -3.0, 2.0])
    motion = GroundMotion("pulse", 0.5, points, "test", "")
    points[1] = 99.0
    assert motion.peak == 3.0
    assert motion.steps == 3
    assert motion.duration == 1.0
    with pytest.raises(ValueError, match="read-only"):
        motion.acceleration[0] = 1.0


@pytest.mark.parametrize(
    ("time_step", "acceleration", "problem"),
    [
        (0.0, [0.0, 1.0], "time step 0 s; a finite number > 0 is required"),
        (-0.01, [0.0, 1.0], "time step -0.01 s; a finite number > 0 is required"),
        (float("nan"), [0.0, 1.0], "time step nan s; a finite number > 0 is required"),
        (float("inf"), [0.0, 1.0], "time step inf s; a finite number > 0 is required"),
        (0.01, [1.0], "one point of acceleration; two or more are required"),
        (0.01, [[0.0, 1.0]], "acceleration of shape (1, 2); (N,) with N >= 2 is required"),
        (0.01, [0.0, np.nan], "acceleration[1] is nan; a finite number is required"),
        (0.01, [-np.inf, 0.0], "acceleration[0] is -inf; a finite number is required"),
    ],
)
def test_bad_motion_is_refused(time_step: float, acceleration: list[float], problem: str) -> None:
    with pytest.raises(InputError) as caught:
        GroundMotion("bad", time_step, np.array(acceleration), "nowhere", "")
    assert str(caught.value) == f"ground motion 'bad' (nowhere): {problem}"


# --------------------------------------------------------------------------------------------------------- AT2 files

UNITS_OF_G = "ACCELERATION TIME SERIES IN UNITS OF G"


def at2(tmp_path: Path, size: str, values: str, units: str = UNITS_OF_G, name: str = "record.AT2") -> Path:
    path = tmp_path / name
    path.write_bytes(
        f"PEER NGA STRONG MOTION DATABASE RECORD\nSOMEWHERE, UNIT 2, 090\n{units}\n{size}\n{values}".encode()
    )
    return path


@pytest.mark.parametrize(
    "size",
    [
        "NPTS=  3, DT= .02000 SEC",
        "NPTS=  3  DT=   .0200 SEC                       ",
        "NPTS=  3, dt=  .02000",
        "NPTS= 3, DT= .0200",
        "npts=3,dt=2.0E-02 sec",
        "NPTS=  3, DT= .2D-01 SEC",
        "NPTS=   3  DT=   .0200 SEC,   5 POLE @    50.00000 HZ,  -5 POLE @      .06000",
        "NPTS=   3  DT=   .0200   5 POLE @    50.00000 HZ",
        "3    0.0200    NPTS, DT",
        "  3, 0.0200, NPTS DT",
    ],
)
def test_every_variant_of_the_size_line_is_read(tmp_path: Path, size: str) -> None:
    motion = read_at2(at2(tmp_path, size, "0.1 -0.2 0.3\n"))
    assert motion.time_step == 0.02
    np.testing.assert_allclose(motion.acceleration / STANDARD_GRAVITY, [0.1, -0.2, 0.3], rtol=1e-15)


@pytest.mark.parametrize(
    "values",
    [
        "   .1000000E+00  -.2000000E+00   .3000000E+00\n",
        "0.1\n-0.2\n0.3",
        "\n 0.1 -0.2\n\n 0.3\n\n\n",
        "  .1000000D+00  -.2000000d+00   +.3D0\n",
        "1.000000e-01-.2000000E+00 3.e-1\n",
        "0.1-0.2+0.3\n",
        "0.1, -0.2, 0.3\n",
        "0.1 -0.2\r\r\n0.3\r\r\n",
        "0.1 -0.2 0.3\n*** End Data ***\nthe end\n",
    ],
)
def test_every_layout_of_the_values_is_read(tmp_path: Path, values: str) -> None:
    motion = read_at2(at2(tmp_path, "NPTS= 3, DT= .01 SEC", values))
    np.testing.assert_allclose(motion.acceleration / STANDARD_GRAVITY, [0.1, -0.2, 0.3], rtol=1e-15)


@pytest.mark.parametrize("line_end", [b"\n", b"\r\n", b"\r\r\n", b"\r"])
def test_every_line_end_is_read(tmp_path: Path, line_end: bytes) -> None:
    path = at2(tmp_path, "NPTS= 4, DT= .01 SEC", "0.1 0.2\n0.3 0.4\n")
    path.write_bytes(path.read_bytes().replace(b"\n", line_end))
    assert read_at2(path).steps == 4
    path.write_bytes(path.read_bytes().replace(b"0.4", b"0.x"))
    assert "line 6: '0.x' is not a finite number" in refusal(path)


@pytest.mark.parametrize(
    ("units", "factor"),
    [
        (UNITS_OF_G, 9.80665),
        ("ACCELERATION TIME HISTORY IN UNITS OF G. FILTER POINTS: HP=0.07 Hz LP=23.0 Hz", 9.80665),
        ("The units are (g)", 9.80665),
        ("ACCELERATION IN UNITS OF CM/SEC/SEC", 0.01),
        ("ACCELERATION, UNITS: cm/s²", 0.01),
        ("ACCELERATION (UNITS = CM/SEC**2)", 0.01),
        ("UNITS OF GAL", 0.01),
        ("UNITS OF M/S^2", 1.0),
        ("units of m/s2, that is, units of m/s/s", 1.0),
    ],
)
def test_unit_comes_from_the_header(tmp_path: Path, units: str, factor: float) -> None:
    path = at2(tmp_path, "NPTS= 2, DT= .01 SEC", "0.0 2.0\n", units)
    assert read_at2(path).peak == pytest.approx(2.0 * factor, rel=1e-15)
    path.write_bytes(path.read_bytes().decode().encode("latin-1"))
    assert read_at2(path).peak == pytest.approx(2.0 * factor, rel=1e-15)


@pytest.mark.parametrize(
    ("units", "found"),
    [
        ("ACCELERATION TIME SERIES", "the header names no unit;"),
        ("ACCELERATION IN UNITS OF FURLONGS", "the header names 'FURLONGS' as unit;"),
        ("UNITS OF G, UNITS OF GAL", "the header names 'G', 'GAL' as unit;"),
    ],
)
def test_header_without_one_known_unit_is_refused(tmp_path: Path, units: str, found: str) -> None:
    message = refusal(at2(tmp_path, "NPTS= 2, DT= .01 SEC", "0.0 2.0\n", units))
    assert f"{found} a line 'UNITS OF G' is required (g, m/s², cm/s² or gal)" in message


@pytest.mark.parametrize(
    ("size", "problem"),
    [
        ("NPTS= 3", "line 4: no NPTS and DT in 'NPTS= 3'; 'NPTS=  4000, DT= .0100 SEC' is required"),
        ("NPTS= 3, DT= SEC", "line 4: no NPTS and DT in 'NPTS= 3, DT= SEC'"),
        ("NPTS= 3.5, DT= .01 SEC", "line 4: no NPTS and DT in 'NPTS= 3.5, DT= .01 SEC'"),
        ("NPTS= -3, DT= .01 SEC", "line 4: no NPTS and DT in 'NPTS= -3, DT= .01 SEC'"),
        (f"NPTS= {'9' * 5000}, DT= .01", f"line 4: no NPTS and DT in 'NPTS= {'9' * 54}...'"),
        ("NPTS= 3, DT= .01.0 SEC", "line 4: '.01.0' is not a finite number"),
        ("NPTS= 3, DT= 1E999 SEC", "line 4: '1E999' is not a finite number"),
        ("NPTS= 3, DT= 10 MSEC", "line 4: DT in 'MSEC'; SEC is required"),
        ("NPTS= 3, DT= 0.0 SEC", "time step 0 s; 1e-05 to 0.2 s is read"),
        ("DT= .01 SEC", "no header line with NPTS and DT"),
        ("NPTS= 4, DT= .01 SEC", "3 values, but line 4 gives NPTS = 4"),
        ("NPTS= 2, DT= .01 SEC", "3 values, but line 4 gives NPTS = 2"),
    ],
)
def test_bad_size_is_refused(tmp_path: Path, size: str, problem: str) -> None:
    assert problem in refusal(at2(tmp_path, size, "0.1 0.2 0.3\n"))


@pytest.mark.parametrize(
    "text", ["NaN", "inf", "-Infinity", "********", "0.1.2", "1_0", "0x1", "0.1E", "1E400", "٣", "0.123E-010.456E-02"]
)
def test_bad_value_is_named_with_its_line(tmp_path: Path, text: str) -> None:
    message = refusal(at2(tmp_path, "NPTS= 4, DT= .01 SEC", f"0.1 0.2\n0.3 {text}\n"))
    assert f"line 6: {text!r} is not a finite number" in message


def test_record_of_one_point_is_refused(tmp_path: Path) -> None:
    assert "one point of acceleration; two or more are required" in refusal(
        at2(tmp_path, "NPTS= 1, DT= .01 SEC", "0.1\n")
    )


@given(
    values=st.lists(st.floats(-98.0, 98.0), min_size=2, max_size=30),
    columns=st.integers(1, 9),
    exponent=st.sampled_from("EeDd"),
    gap=st.sampled_from(["", " ", "   "]),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # the one file is written anew each time
def test_fixed_width_values_are_read_back(
    tmp_path: Path, values: list[float], columns: int, exponent: str, gap: str
) -> None:
    # without a gap, only a sign separates two values, as in a full Fortran column
    cells = [f"{value:+.7E}".replace("E", exponent) for value in values]
    rows = [gap.join(cells[i : i + columns]) for i in range(0, len(cells), columns)]
    path = at2(tmp_path, f"NPTS= {len(values)}, DT= .005 SEC", "\n".join(rows), "UNITS OF M/S2")
    np.testing.assert_array_equal(read_at2(path).acceleration, [float(f"{value:.7E}") for value in values])


# -------------------------------------------------------------------------------------------------- by name or path


@pytest.mark.parametrize("name", ["record.at2", "record.AT2", "record.At2", "a.b.at2"])
def test_extension_is_read_in_any_case(tmp_path: Path, name: str) -> None:
    path = at2(tmp_path, "NPTS= 2, DT= .01 SEC", "0.0 2.0\n", name=name)
    assert read_ground_motion(str(path)).steps == 2


@pytest.mark.parametrize("name", ["record", "el_centro", ".at2"])
def test_unknown_name_is_told_what_is_shipped(tmp_path: Path, name: str) -> None:
    message = refusal(f"{tmp_path}/{name}")
    assert message.endswith("is neither a file nor a shipped record (el_centro_1940_ns)")


@pytest.mark.parametrize("name", ["record.txt", "record", "record.dat"])
def test_unknown_content_is_told_what_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("a letter, not a record\n")
    message = refusal(tmp_path / name)
    assert "not a ground motion in a format that is read: PEER AT2, CSV, K-NET, COSMOS V2, CSMIP V2, Geo" in message


@pytest.mark.parametrize("suffix", READ_SUFFIXES)
def test_unreadable_files_are_refused_in_one_line(tmp_path: Path, suffix: str) -> None:
    assert refusal(tmp_path / f"absent{suffix}").endswith("cannot be read: No such file or directory")
    assert "cannot be read: File name too long" in refusal(tmp_path / f"{'x' * 300}{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    assert refusal(tmp_path / f"folder{suffix}").endswith("cannot be read: Is a directory")
    for name, content, problem in (
        ("empty", b"", "the file is empty"),
        ("blank", b" \r\n \n", "the file is empty"),
        ("binary", bytes(range(256)), "a binary file; text is required"),
    ):
        path = tmp_path / f"{name}{suffix}"
        path.write_bytes(content)
        assert refusal(path) == f"{path}: {problem}"


@pytest.mark.parametrize("suffix", READ_SUFFIXES)
@given(content=st.binary(max_size=200))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_arbitrary_bytes_are_refused_in_one_line(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"junk{suffix}"
    path.write_bytes(content)
    refusal(path)


def test_path_no_file_system_takes_is_refused() -> None:
    with pytest.raises(InputError, match=r"^'a\\x00b\.at2': cannot be read: .*null"):
        read_ground_motion("a\0b.at2")
