"""Columns of numbers as strangers have them: with a header in some dialect, or with none."""

from __future__ import annotations

import numpy as np
import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import read_ground_motion
from bmd_rths_core.ground_motion.config import GroundMotionConfig, select_ground_motion
from tests.core.field_records import GRAVITY, WAVE, assert_wave, at2, csv, refusal


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
