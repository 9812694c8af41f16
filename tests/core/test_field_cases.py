"""Records as strangers have them: every kind of fault that was met in the field, made here."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import GroundMotion, read_ground_motion
from bmd_rths_core.ground_motion.catalogue import catalogue
from bmd_rths_core.ground_motion.config import GroundMotionConfig, select_ground_motion
from bmd_rths_core.ground_motion.formats.mat5 import DamagedMat, read_variables
from tests.core.record_samples import COMPONENTS, SAMPLES, TIME, TIME_STEP, cosmos, csmip, esm, knet, mat

#: 200 points of a wave in g.
WAVE = 0.2 * np.sin(2 * np.pi * 1.7 * 0.005 * np.arange(200))
GRAVITY = 9.80665


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a file."""

    def write(content: bytes | str, name: str = "record.txt") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def refusal(path: Path, **options: object) -> str:
    """Return the one line a file is refused with, behind its path."""
    with pytest.raises(InputError) as caught:
        read_ground_motion(path, **options)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message.removeprefix(f"{path}: ")


def at2(
    heading: str = "ACCELERATION TIME SERIES IN UNITS OF G",
    size: str = "NPTS=    200, DT=   .0050 SEC",
    values: np.ndarray = WAVE,
) -> str:
    cells = [f"{value:15.7E}" for value in values]
    rows = ["".join(cells[i : i + 5]) for i in range(0, len(cells), 5)]
    return "\n".join(["PEER NGA STRONG MOTION DATABASE RECORD", "Somewhere, 1/1/2000, X, 67", heading, size, *rows, ""])


def assert_wave(motion: GroundMotion, unit: float = GRAVITY) -> None:
    assert (motion.steps, motion.time_step) == (200, pytest.approx(0.005, rel=1e-12))
    np.testing.assert_allclose(motion.acceleration, WAVE * unit, atol=1e-7 * unit)


def csv(header: str = "time_s,acceleration_g", separator: str = ",", columns: int = 1) -> str:
    rows = [separator.join([f"{0.005 * i:.3f}"] + [f"{v:.8f}"] * columns) for i, v in enumerate(WAVE)]
    return "\n".join([header, *rows, ""])


# ------------------------------------------------------------------------------------------ bytes and case of letters


@pytest.mark.parametrize("name", [name for name in SAMPLES if name not in ("MAT", "JMA CSV")])
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_text_is_read_in_every_encoding(write, name: str, encoding: str) -> None:
    sample = SAMPLES[name]
    path = write(sample.content.decode().encode(encoding))
    motion = read_ground_motion(path, sample.names[0], sample.unit)
    np.testing.assert_allclose(motion.acceleration, COMPONENTS[0] / 100.0, atol=1e-14)


@pytest.mark.parametrize("name", [name for name in SAMPLES if name not in ("MAT", "GeoNet V2A")])
def test_blank_lines_above_a_record_are_passed_over(write, name: str) -> None:
    sample = SAMPLES[name]
    motion = read_ground_motion(write(b"\n \r\n" + sample.content), sample.names[0], sample.unit)
    np.testing.assert_allclose(motion.acceleration, COMPONENTS[0] / 100.0, atol=1e-14)


@pytest.mark.parametrize("name", ["K-NET", "COSMOS V2", "CSMIP V2", "ESM", "CWA", "JMA CSV"])
@pytest.mark.parametrize("case", [bytes.lower, bytes.upper])
def test_keys_are_read_in_any_case(write, name: str, case: Callable[[bytes], bytes]) -> None:
    sample = SAMPLES[name]
    motion = read_ground_motion(write(case(sample.content)), sample.names[0], sample.unit)
    np.testing.assert_allclose(motion.acceleration, COMPONENTS[0] / 100.0, atol=1e-14)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_at2_is_read_in_utf_16_and_with_a_byte_order_mark(write, encoding: str) -> None:
    assert_wave(read_ground_motion(write(at2().encode(encoding), "a.AT2")))


@pytest.mark.parametrize(
    "heading",
    ["  Acceleration in g", "ACCELERATION (G)", "Accel. [g]", "acceleration time history in g", "ACC (g)"],
)
def test_unit_beside_the_word_acceleration_is_read(write, heading: str) -> None:
    assert_wave(read_ground_motion(write(at2(heading))))


# ------------------------------------------------------------------------------------------- what a file says of itself


@pytest.mark.parametrize("heading", ["UNITS OF G X 1000", "UNITS OF G*1000", "UNITS OF (G) / 10", "Units: 1000 x g",
                                     "ACCELERATION IN UNITS OF G TIMES 10"])  # fmt: skip
def test_factor_on_the_unit_is_refused(write, heading: str) -> None:
    assert refusal(write(at2(heading))).startswith("line 3: a factor on the unit, ")


def test_factor_on_the_unit_is_refused_in_every_format(write) -> None:
    factor = b"a factor on the unit"
    for content in (
        esm().replace(b"cm/s^2\n", b"cm/s^2 x 10\n", 1),
        cosmos().replace(b"cm/sec2(04)", b"cm/sec2 x 1000"),
        csmip().replace(b"CM/SEC/SEC)", b"CM/SEC/SEC X 10)"),
        SAMPLES["GeoNet V2A"].content.replace(b"mm/s/s at", b"mm/s/s x 10 at"),
    ):
        assert factor.decode() in refusal(write(content), component="HNN")
    with pytest.raises(InputError, match="no unit of acceleration in column"):
        read_ground_motion(write(csv("time_s,acceleration (g x 1000)")))
    json_factor = json.dumps({"dT": 0.1, "data_x": [0.0, 1.0], "scaleFactor": 9.81})
    assert "a factor on the values, scaleFactor" in refusal(write(json_factor))


@pytest.mark.parametrize(
    ("heading", "quantity"),
    [
        ("VELOCITY TIME SERIES IN UNITS OF G", "velocity"),
        ("Displacement time series in units of cm", "displacement"),
        ("UNITS OF CM/S", "velocity"),
        ("units: cm", "displacement"),
        ("RESPONSE SPECTRUM OF ACCELERATION IN UNITS OF G", "spectrum"),
        ("UNCORRECTED ACCELERATION IN UNITS OF G", "n uncorrected record"),
    ],
)
def test_another_quantity_is_called_by_its_name(write, heading: str, quantity: str) -> None:
    assert f"line 3: a{'' if quantity[0] == 'n' else ' '}{quantity}" in refusal(write(at2(heading)))


@pytest.mark.parametrize("width", [9, 10])
def test_uncorrected_csmip_is_refused_whatever_its_columns(write, width: int) -> None:
    cells = [f"{value:{width}.3f}" for value in WAVE]
    rows = ["".join(cells[i : i + 8]) for i in range(0, 200, 8)]
    heading = ["UNCORRECTED ACCELEROGRAM DATA", "CHAN  1:  90 DEG"]
    data = "  200 POINTS OF ACCEL DATA EQUALLY SPACED AT .005 SEC.  (UNITS: G)"
    content = "\n".join([*heading, data, *rows, "/& --- END OF DATA FOR CHANNEL  1 ---", ""])
    assert refusal(write(content, "a.V1")).startswith("line 1: an uncorrected record, by 'UNCORRECTED ACCELEROGRAM")


def test_corrected_csmip_that_names_its_uncorrected_source_is_read(write) -> None:
    content = csmip().replace(b"A MADE-UP RECORD", b"UNCORRECTED ACCELEROGRAM DATA PROCESSED 1/1/2000")
    assert read_ground_motion(write(content), "UP").steps == 24


def test_uncorrected_baseline_is_refused_unless_it_will_be_corrected(write) -> None:
    content = esm().replace(b"HEADER_FORMAT", b"BASELINE_CORRECTION: BASELINE NOT REMOVED\nHEADER_FORMAT")
    path = write(content)
    expected = "line 10: BASELINE_CORRECTION is 'BASELINE NOT REMOVED': an uncorrected record; "
    assert refusal(path) == expected + "ground_motion.high_pass_frequency > 0 is required"
    with pytest.raises(InputError, match="an uncorrected record"):
        catalogue(path)
    config = GroundMotionConfig(record=str(path), high_pass_frequency=1.0)
    assert select_ground_motion(config, TIME_STEP).peak == pytest.approx(1.0)


@pytest.mark.parametrize(("unit", "factor"), [("cm/s2", 0.01), ("g", GRAVITY), ("m/s2", 1.0)])
@pytest.mark.parametrize("key", ["unit", "Units", "accUnit"])
def test_unit_key_of_simcenter_is_used(write, key: str, unit: str, factor: float) -> None:
    path = write(json.dumps({"dT": 0.005, "data_x": list(WAVE), key: unit}))
    assert_wave(read_ground_motion(path), factor)
    assert refusal(path, unit="g").startswith("the file states its unit")


@pytest.mark.parametrize("unit", ["cm/s", "parsec", 3, {"a": "g"}])
def test_unit_key_that_is_no_unit_of_acceleration_is_refused(write, unit: object) -> None:
    message = refusal(write(json.dumps({"dT": 0.005, "data_x": [0.0, 0.1], "unit": unit})), unit="g")
    assert "an acceleration in g, m/s², cm/s² or gal is required" in message


@pytest.mark.parametrize("mark", [-999.0, 9999.0, -9999.9, 999.99])
@pytest.mark.parametrize("point", [0, 101, 199])
def test_mark_of_a_missing_value_is_refused_at_its_line(write, mark: float, point: int) -> None:
    values = WAVE.copy()
    values[point] = mark
    assert f"line {5 + point // 5}: {mark:g} is a mark of a missing value" in refusal(write(at2(values=values)))
    rows = csv().splitlines()
    rows[point + 1] = f"{0.005 * point:.3f},{mark}"
    assert f"line {point + 2}: {mark:g} is a mark" in refusal(write("\n".join([*rows, ""])))


def test_mark_the_header_declares_is_refused(write) -> None:
    declared = b"Values used when parameter or data value is unknown/unspecified:   -888, 7.5\n"
    content = cosmos().replace(b"A made-up record\n", declared, 1).replace(b"    25.900", b"     7.500", 1)
    assert "7.5 is the mark of an unknown value, as the header declares it" in refusal(write(content), component="HNN")


def test_a_value_that_happens_to_be_a_mark_is_read(write) -> None:
    wave = np.round(1500 * np.sin(2 * np.pi * np.arange(200) / 100), 0)
    wave[10] = 999.0  # between 986 and 1063, or thereabouts
    content = at2("UNITS OF GAL", values=wave)
    assert read_ground_motion(write(content)).acceleration[10] == 9.99


# --------------------------------------------------------------------------------------------------------- plausibility


def test_constant_leaves_nothing_to_scale(write) -> None:
    path = write("time_s,acceleration_m_s2\n" + "".join(f"{0.005 * i:.3f},0.3\n" for i in range(800)))
    config = GroundMotionConfig(record=str(path), high_pass_frequency=0.1)
    with pytest.raises(InputError, match=r"constant at 0\.3 m/s²; nothing but rounding is left of it above 0.1 Hz"):
        select_ground_motion(config, 0.005)


def test_dead_channel_of_counts_is_zero(write) -> None:
    header = knet().split(b"\nMemo.")[0] + b"\nMemo.             \n"
    path = write(header + b"     5001" * 24 + b"\n")
    assert read_ground_motion(path).peak == 0.0


def test_noise_is_not_scaled_to_a_test(write) -> None:
    path = write("time_s,acceleration_m_s2\n" + "".join(f"{0.005 * i:.3f},{1e-9 * (i % 3)}\n" for i in range(80)))
    with pytest.raises(InputError, match="is no ground motion but noise or rounding"):
        select_ground_motion(GroundMotionConfig(record=str(path)), 0.005)


def test_acceleration_in_the_wrong_unit_is_refused(write) -> None:
    message = refusal(write(at2(values=980.665 * WAVE)))
    assert message.startswith("1923 m/s² at point") or "is no ground acceleration; at most 100 m/s²" in message


def test_one_point_is_refused(write) -> None:
    message = refusal(write(at2(size="NPTS= 1, DT= .005 SEC", values=WAVE[:1])))
    assert message.endswith("one point of acceleration; two or more are required")


# --------------------------------------------------------------------------------------------------------- completeness


@pytest.mark.parametrize("cut", range(2, 9))
def test_csv_cut_inside_its_last_number_is_refused(write, cut: int) -> None:
    whole = csv()
    message = refusal(write(whole[:-cut]))
    assert message.startswith("line 201: ")
    assert_wave(read_ground_motion(write(whole[:-1])))  # only the line end is missing


@pytest.mark.parametrize("name", ["K-NET", "ESM", "CWA", "JMA CSV"])
def test_last_number_that_was_cut_is_refused(write, name: str) -> None:
    sample = SAMPLES[name]
    assert "the file is cut off" in refusal(write(sample.content.rstrip()[:-1]), component=sample.names[-1])


@pytest.mark.parametrize("cut", [1, 2, 3, 4])
def test_at2_cut_inside_its_last_number_is_refused(write, cut: int) -> None:
    assert refusal(write(at2()[: -1 - cut]))


@pytest.mark.parametrize("size", ["NPTS=    200, DT= 0,0050 SEC", "NPTS= 200, DT=0,005"])
def test_decimal_comma_is_named_with_its_line(write, size: str) -> None:
    assert "line 4: " in refusal(write(at2(size=size)))
    assert "decimal comma" in refusal(write(at2(size=size)))


def test_values_with_decimal_commas_are_named_with_their_line(write) -> None:
    head, body = at2().split("SEC\n")
    assert "line 5: " in refusal(write(head + "SEC\n" + body.replace(".", ",")))


# ----------------------------------------------------------------------------------------------------- csv and numbers


@pytest.mark.parametrize(
    "header",
    ["Time (sec),Acceleration (g)", "time [s], acc [g]", "t_s,acc_g", "TIME (S),ACCELERATION (G)", "Time(s),Accel(g)",
     "time_sec,acceleration_g", "time s,acceleration g"],
)  # fmt: skip
def test_header_of_csv_is_read_in_its_dialects(write, header: str) -> None:
    assert_wave(read_ground_motion(write(csv(header))))


@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_csv_is_read_with_every_separator(write, separator: str) -> None:
    assert_wave(read_ground_motion(write(csv(separator.join(["time_s", "acc_g"]), separator))))
    assert_wave(read_ground_motion(write(csv(separator.join(["time (s)", "acc (g)"]), separator))))


def test_csv_with_decimal_commas_between_semicolons_is_read(write) -> None:
    assert_wave(read_ground_motion(write("time_s;acc_g\n" + csv("", ";").lstrip("\n").replace(".", ","))))


def test_units_in_a_row_of_their_own_are_read(write) -> None:
    assert_wave(read_ground_motion(write(csv("Station X\ntime,acceleration\ns,g"))))


def test_time_in_milliseconds_is_read(write) -> None:
    rows = "".join(f"{5 * i},{v:.8f}\n" for i, v in enumerate(WAVE))
    assert_wave(read_ground_motion(write("time_ms,acc_g\n" + rows)))


@pytest.mark.parametrize("component", ["ns", "NS", "acc_ns_g"])
def test_component_of_csv_is_asked_for(write, component: str) -> None:
    path = write(csv("time_s,acc_ns_g,acc_ew_g", columns=2))
    assert "must be one of 'ns', 'ew'" in refusal(path)
    assert_wave(read_ground_motion(path, component))


def test_bracketed_units_of_acceleration_are_components(write) -> None:
    path = write(csv("time [s],NS [cm/s2],EW [cm/s2]", columns=2))
    assert_wave(read_ground_motion(path, "EW"), 0.01)


@pytest.mark.parametrize("header", ["T (s),Acceleration (g)", "Period (s),Sa (g)", "period_s,acc_g", "T (s),PSA (g)"])
def test_response_spectrum_is_refused(write, header: str) -> None:
    assert "is a response spectrum" in refusal(write(csv(header), "a.csv"))


def test_one_column_of_numbers_needs_step_and_unit(write) -> None:
    path = write("".join(f"{v:.8f}\n" for v in WAVE))
    assert refusal(path).startswith("the file states no unit and no time step")
    assert "record_time_step (--dt) must give it" in refusal(path, unit="g")
    assert_wave(read_ground_motion(path, unit="g", time_step=0.005))
    config = GroundMotionConfig(record=str(path), unit="g", record_time_step=0.005, peak_acceleration=0.0)
    assert_wave(select_ground_motion(config, 0.005))


def test_two_columns_of_numbers_need_their_names(write) -> None:
    path = write(csv("# OpenSees", " "))
    assert "must say what each is: 'time,acceleration'" in refusal(path, unit="g")
    assert_wave(read_ground_motion(path, unit="g", columns="time,acceleration"))
    two = write(csv("", " ", columns=2).lstrip("\n"))
    assert_wave(read_ground_motion(two, unit="g", columns="time,-,EW"))
    assert_wave(read_ground_motion(two, "EW", unit="g", columns="time,NS,EW"))
    assert "names 2 columns" in refusal(two, unit="g", columns="time,NS")
    assert "the file states its time step" in refusal(two, unit="g", columns="time,-,EW", time_step=0.01)


def test_series_over_several_columns_is_read(write) -> None:
    rows = [" ".join(f"{v:.8E}" for v in WAVE[i : i + 8]) for i in range(0, 200, 8)]
    path = write("\n".join([*rows, ""]))
    assert_wave(read_ground_motion(path, unit="g", time_step=0.005, columns="series"))
    assert "a file in format PEER AT2 says what it holds" in refusal(write(at2(), "b.AT2"), columns="series")


def test_columns_that_are_named_need_no_header(write) -> None:
    path = write(csv("whatever the program wrote;above", ","))
    assert_wave(read_ground_motion(path, unit="g", columns="time,x"))


def test_time_step_that_does_not_divide_the_loop_needs_resampling(write) -> None:
    time = 0.004 * np.arange(400)
    wave = 0.3 * np.sin(2 * np.pi * 2.0 * time) * np.sin(np.pi * time / time[-1]) ** 2
    path = write(at2(size="NPTS= 400, DT= .0040 SEC", values=wave))
    config = GroundMotionConfig(record=str(path), peak_acceleration=0.0)
    with pytest.raises(InputError, match=r"ground_motion\.resample=true for band-limited interpolation"):
        select_ground_motion(config, 0.005)
    config = GroundMotionConfig(record=str(path), peak_acceleration=0.0, resample=True)
    motion = select_ground_motion(config, 0.005)
    there = 0.005 * np.arange(motion.steps)
    exact = GRAVITY * 0.3 * np.sin(2 * np.pi * 2.0 * there) * np.sin(np.pi * there / time[-1]) ** 2
    np.testing.assert_allclose(motion.acceleration, exact, atol=2e-4 * GRAVITY * 0.3)


# ------------------------------------------------------------------------------------------------------------------ mat


def test_own_reader_of_mat_agrees_with_scipy() -> None:
    rng = np.random.default_rng(1)
    variables = {"a": rng.normal(size=(2, 30)), "b": rng.normal(size=(5, 1)).astype(np.float32), "c": np.arange(6.0),
                 "n": np.arange(8, dtype=np.int16), "s": 3.5, "t": "text", "z": np.zeros((2, 2)) + 1j,
                 "cell": np.array([1, "x"], dtype=object), "st": {"u": 1.0}}  # fmt: skip
    for compress in (False, True):
        stream = io.BytesIO()
        scipy.io.savemat(stream, variables, do_compression=compress)
        found = {variable.name: variable for variable in read_variables(stream.getvalue(), 10**8)}
        assert set(found) == set(variables)
        theirs = scipy.io.loadmat(io.BytesIO(stream.getvalue()))
        for name in ("a", "b", "c", "n", "s"):
            np.testing.assert_array_equal(found[name].values, theirs[name])
        assert [found[name].values for name in ("t", "z", "cell", "st")] == [None] * 4


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=300, deadline=None)
@given(data=st.data(), compress=st.booleans())
def test_damaged_mat_is_one_error_and_never_the_end_of_the_process(data: st.DataObject, compress: bool) -> None:

    stream = io.BytesIO()
    scipy.io.savemat(stream, {"eq": np.vstack([TIME, TIME])}, do_compression=compress)
    content = bytearray(stream.getvalue())
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    with suppress(DamagedMat):
        read_variables(bytes(content[: data.draw(st.integers(0, len(content)))]), 10**6)


def test_data_of_type_zero_are_damage(write) -> None:

    stream = io.BytesIO()
    scipy.io.savemat(stream, {"eq": np.vstack([TIME * TIME_STEP, COMPONENTS[0]])})
    content = bytearray(stream.getvalue())
    place = content.index(struct.pack("<II", 9, 8 * 48))
    content[place : place + 4] = struct.pack("<I", 0)
    assert refusal(write(bytes(content))).startswith("a damaged MATLAB file: ")


def test_objects_beside_an_array_are_passed_over_and_told(write) -> None:
    # an object of a class written in MATLAB: flags, name, "MCOS", class, as its compiler writes them
    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data.ljust(-(-len(data) // 8) * 8, b"\0")

    body = element(6, struct.pack("<II", 17, 0)) + element(1, b"thing") + element(1, b"MCOS") + element(1, b"table")
    path = write(mat(eq=np.vstack([TIME * TIME_STEP, COMPONENTS[0]])) + element(14, body), "a.mat")
    motion = read_ground_motion(path, unit="gal")
    np.testing.assert_allclose(motion.acceleration, COMPONENTS[0] / 100.0, atol=1e-14)
    (entry,) = catalogue(path)
    assert entry.note == "objects are passed over: 'thing'"


@pytest.mark.parametrize("variables", [{"dt": 0.005, "acc": WAVE}, {"time": 0.005 * np.arange(200), "acc": WAVE},
                                       {"DT": 0.005, "acc": WAVE[:, None], "note": "x"}])  # fmt: skip
def test_vector_beside_its_time_step_is_read(write, variables: dict[str, object]) -> None:
    assert_wave(read_ground_motion(write(mat(**variables), "a.mat"), unit="g"))


def test_vector_without_a_time_step_needs_one(write) -> None:
    path = write(mat(acc=WAVE, other=WAVE), "a.mat")
    assert "record_time_step (--dt) must give it" in refusal(path, component="acc", unit="g")
    assert_wave(read_ground_motion(path, "acc", "g", time_step=0.005))
    assert "may be no acceleration" in refusal(write(mat(dt=0.1, vel=WAVE)), unit="g")


# ---------------------------------------------------------------------------------------------------------- smc and sac


def smc(title: str = "2 CORRECTED ACCELEROGRAM", values: np.ndarray = 100 * WAVE) -> str:
    integers, reals = np.full(48, -32768), np.full(50, 1.7e38)
    integers[15], integers[16], reals[1] = 2, len(values), 200.0
    lines = [title, *["*"] * 10]
    lines += ["".join(f"{n:10d}" for n in integers[i : i + 8]) for i in range(0, 48, 8)]
    lines += ["".join(f"{x:15.7E}" for x in reals[i : i + 5]) for i in range(0, 50, 5)]
    lines += ["| made up", "|"]
    lines += ["".join(f"{x:10.4f}" for x in values[i : i + 8]) for i in range(0, len(values), 8)]
    return "\n".join([*lines, ""])


def test_smc_is_read(write) -> None:
    motion = read_ground_motion(write(smc()))
    assert (motion.steps, motion.time_step) == (200, 0.005)
    np.testing.assert_allclose(motion.acceleration, WAVE, atol=1e-6)


@pytest.mark.parametrize(
    ("title", "found"),
    [("1 UNCORRECTED ACCELEROGRAM", "an uncorrected record"), ("3 VELOCITY", "a velocity"),
     ("4 DISPLACEMENT", "a displacement"), ("5 RESPONSE SPECTRA", "a spectrum")],
)  # fmt: skip
def test_smc_of_another_kind_is_called_by_its_name(write, title: str, found: str) -> None:
    assert refusal(write(smc(title))).startswith(f"line 1: {found}, by ")


def test_smc_that_is_cut_is_refused(write) -> None:
    assert "the file ends after" in refusal(write("\n".join(smc().splitlines()[:-1])))
    assert "columns of 10 characters" in refusal(write(smc().rstrip()[:-3]))


def sac(order: str = "<", quantity: int = 8, values: np.ndarray = WAVE) -> bytes:
    floats, words = [-12345.0] * 70, [-12345] * 40
    floats[0] = 0.005
    words[76 - 70], words[79 - 70], words[85 - 70], words[86 - 70], words[105 - 70] = 6, len(values), 1, quantity, 1
    names = b"-12345  " * 24
    names = names[:160] + b"HNE     " + names[168:]
    head = struct.pack(f"{order}70f", *floats) + struct.pack(f"{order}40i", *words) + names[:192]
    return head + values.astype(f"{order}f4").tobytes()


@pytest.mark.parametrize("order", ["<", ">"])
def test_sac_is_read(write, order: str) -> None:
    path = write(sac(order))
    assert "states no unit" in refusal(path)
    assert_wave(read_ground_motion(path, "HNE", "g"))


@pytest.mark.parametrize(("quantity", "name"), [(6, "displacement"), (7, "velocity")])
def test_sac_of_another_quantity_is_called_by_its_name(write, quantity: int, name: str) -> None:
    assert refusal(write(sac(quantity=quantity)), unit="g").startswith(f"a {name}, by its header")


def test_sac_that_is_cut_is_refused(write) -> None:
    assert "200 points need 1432" in refusal(write(sac()[:-4]), unit="g")


# ------------------------------------------------------------------------------------------------------------- archives


def zipped(files: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return stream.getvalue()


def test_records_inside_archives_are_components(write) -> None:
    inner = zipped({"CHAN001.V2": csmip(), "readme.txt": b"of the agency"})
    path = write(zipped({"a/b.zip": inner, "x.AT2": at2().encode()}), "cesmd.zip")
    assert "must be one of" in refusal(path)
    names = [entry.component for entry in catalogue(path)]
    assert names == ["b.zip CHAN001.V2 90 DEG", "b.zip CHAN001.V2 UP", "b.zip CHAN001.V2 0 DEG", "x.AT2"]
    assert_wave(read_ground_motion(path, "x.AT2"))
    motion = read_ground_motion(path, "b.zip CHAN001.V2 UP")
    np.testing.assert_allclose(motion.acceleration, COMPONENTS[1] / 100.0, atol=1e-14)


def test_archive_that_grows_is_refused(write) -> None:
    assert "100 MB inside" in refusal(write(zipped({"zeros.txt": bytes(120_000_000)})))


def test_archive_without_a_record_is_refused(write) -> None:
    assert "without a ground motion" in refusal(write(zipped({"readme.txt": b"hello"})))
    assert "a damaged archive" in refusal(write(zipped({"readme.txt": b"hello"})[:-30]))


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150, deadline=None)
@given(data=st.data(), kind=st.sampled_from(["smc", "sac", "zip", "csv", "numbers", "miniseed", "afad"]))
def test_damaged_records_are_read_or_refused_in_one_line(tmp_path: Path, data: st.DataObject, kind: str) -> None:
    samples = {
        "smc": smc().encode(),
        "sac": sac(),
        "zip": zipped({"x.AT2": at2().encode()}),
        "csv": csv("time_s,acc_ns_g,acc_ew_g", columns=2).encode(),
        "numbers": csv("", " ").lstrip().encode(),
        "afad": afad(),
        "miniseed": b"000001D XXX  00HNEYY" + bytes(492),
    }
    content = bytearray(samples[kind])
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + data.draw(st.integers(0, 9))] = data.draw(st.binary(max_size=9))
    path = tmp_path / "record"
    path.write_bytes(content)
    try:
        read_ground_motion(path, "ns" if kind == "csv" else "only", time_step=0.0)
    except InputError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017  (either is right)


def afad(values="", header="", names="     N-S         E-W         U-D     ", peaks="RAW PGA VALUES (gal)", points=60):
    """Return an old AFAD file, as its readers elsewhere describe it: raw values in gal."""
    rows = values or "".join(f"{10 * np.sin(0.3 * i):12.6f}{5 * np.cos(0.3 * i):12.6f}{i:12.6f}\n" for i in range(60))
    return (
        "STRONG GROUND MOTION RECORDS OF TURKIYE\nPLACE\t:\tDÜZCE METEOROLOJI MÜDÜRLÜGÜ\n"
        "EARTHQUAKE DATE\t:\t17/08/1999 00:01:39.07 (GMT)\nEPICENTER COORDINATES : 40.75000N - 29.86000E\n"
        f"{header}NUMBER OF DATA\t:\t{points}\nSAMPLING INTERVAL(sec)\t:\t0.010000\n"
        f"{peaks}\t:\t(N-S) 9.99 (E-W) 5.00 (U-D) 59.00\n\nBy using these data you agree\n\n{names}\n{rows}"
    ).encode("latin-1")


def test_old_text_of_afad_is_read_and_is_raw(tmp_path):
    path = tmp_path / "19990817.txt"
    path.write_bytes(afad())
    with pytest.raises(InputError, match=r"line 7: .*RAW PGA VALUES"):
        read_ground_motion(path, "N-S")
    motion = read_ground_motion(path, "e-w", high_pass=True)
    assert motion.time_step == 0.01
    np.testing.assert_allclose(motion.acceleration, 0.05 * np.cos(0.3 * np.arange(60)), atol=1e-8)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (afad(points=61), "60 .* 61"),
        (afad(points=0), "line 5: '0'; a number > 0"),
        (afad(points="many"), "line 5: "),
        (afad(names="a b c"), "no line with the names N-S"),
        (afad(peaks="PEAKS"), "no header line 'RAW PGA'"),
        (afad(peaks="RAW PGA VALUES (furlong)"), "line 7: "),
        (afad(values="1.0 2.0 3.0\n1.0 2.0\n"), "line 13: "),
        (b"STRONG GROUND MOTION RECORDS OF TURKIYE", "no line with the names"),
    ],
)
def test_wrong_text_of_afad_is_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "x.txt"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as refused:
        read_ground_motion(path, "N-S", high_pass=True)
    assert len(str(refused.value).splitlines()) == 1


def asdf(rates=(200.0, 200.0), name="XX.STA..HN{}", file_format="ASDF", values=None, twice=False):
    """Return an ASDF file of one station, as its definition has it."""
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        file.attrs["file_format"] = np.bytes_(file_format)
        station = file.create_group("Waveforms/XX.STA")
        station.create_dataset("StationXML", data=np.frombuffer(b"<xml/>", np.int8))
        for i, rate in enumerate(rates):
            channel = name.format("NE"[0 if twice else i])
            data = np.sin(0.1 * np.arange(50)) * (1 + i) if values is None else values
            dataset = station.create_dataset(f"{channel}__2000-01-01T00:00:0{i}__2000-01-01T00:00:09__raw", data=data)
            dataset.attrs["sampling_rate"] = rate
    return out.getvalue()


@pytest.mark.parametrize("component", ["XX.STA..HNE", "hne"])
def test_asdf_is_read_by_channel(tmp_path, component):
    path = tmp_path / "a.h5"
    path.write_bytes(asdf())
    motion = read_ground_motion(path, component, "g")
    assert motion.time_step == 0.005
    np.testing.assert_allclose(motion.acceleration, 2.0 * 9.80665 * np.sin(0.1 * np.arange(50)), rtol=1e-12)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (asdf(file_format="HDF"), "an HDF5 file, but no ASDF"),
        (asdf(rates=(0.0, 200.0)), "at 0 Hz; one row at a rate > 0"),
        (asdf(values=np.zeros((3, 4))), "one row at a rate > 0"),
        (asdf(twice=True), "HNN has 2 pieces with gaps between"),
        (asdf()[:1200], "damaged, or no ASDF"),
        (asdf()[:8] + bytes(200), "damaged, or no ASDF"),
    ],
)
def test_wrong_asdf_is_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "a.h5"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as refused:
        read_ground_motion(path, "HNN", "g")
    assert len(str(refused.value).splitlines()) == 1


def test_asdf_that_crashes_the_library_does_not_end_this_process(tmp_path, monkeypatch):
    monkeypatch.setattr("bmd_rths_core.ground_motion.formats.asdf._READ", "import os; os.kill(os.getpid(), 11)")
    path = tmp_path / "a.h5"
    path.write_bytes(asdf())
    with pytest.raises(InputError, match="the HDF5 library ended with signal 11"):
        read_ground_motion(path, "HNN", "g")
