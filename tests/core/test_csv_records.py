"""Records in CSV: unit and time come from the columns, and what is wrong is named with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.ground_motion import read_csv
from tests.core.test_ground_motion import refusal


def csv_file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "record.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("time_s,acceleration_g", 9.80665),
        ("t_s,acceleration_m_s2", 1.0),
        ("time [s],acceleration [g]", 9.80665),
        ('"Time [s]", "Acceleration [m/s^2]"', 1.0),
        ("time [s],acceleration [m/s2]", 1.0),
        ("time [s],acceleration [m/s²]", 1.0),
        ("time (s),acceleration (cm/s^2)", 0.01),
        ("time_s,acceleration_cm_s2", 0.01),
        ("time_s,acceleration_gal", 0.01),
        ("\ufefftime_s,acceleration [gal]", 0.01),
    ],
)
def test_unit_comes_from_the_column(tmp_path: Path, header: str, factor: float) -> None:
    motion = read_csv(csv_file(tmp_path, f"{header}\n0,0\n0.02,-3\n0.04,1e0\n"))
    assert motion.time_step == 0.02
    np.testing.assert_allclose(motion.acceleration, np.array([0.0, -3.0, 1.0]) * factor, rtol=1e-15)


def test_comments_blank_lines_and_other_columns_are_passed_over(tmp_path: Path) -> None:
    text = "# a record\n#\n\nindex,acceleration_m_s2,remark,time_s\n0,1.5,start,0.0\n\n1,2.5,,0.1\n# cut here\n"
    np.testing.assert_array_equal(read_csv(csv_file(tmp_path, text)).acceleration, [1.5, 2.5])


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("0,0\n0.1,1\n0.2,2\n", "2 columns of numbers; ground_motion.columns (--columns) must say what each is"),
        ("time_s,velocity_m_s\n0,0\n0.1,1\n", "0 acceleration columns in 'time_s,velocity_m_s' ('velocity_m_s'"),
        (
            "time_s,ns_g,velocity_m/s\n0,0,0\n0.1,1,1\n",
            "acceleration columns in 'time_s,ns_g,velocity_m/s' ('velocity_m/s' is a",
        ),
        ("time_s,acceleration_g\n0,0\n5,1\n10,2\n", "time step 5 s; 1e-05 to 0.2 s is read. Is its unit right?"),
        ("time_ms,acceleration_g\n0,0\n5e-6,1\n1e-5,2\n", "time step 5e-09 s; 1e-05 to 0.2 s is read"),
        ("time_s,acceleration_g,acceleration_gal\n0,0,0\n0.1,1,1\n", "one of 'acceleration_g', 'acceleration_gal'"),
        ("time_s,acc_x_g,acc_y_g\n0,0,0\n0.1,1,1\n", "2 components; ground_motion.component (--component) must be"),
        ("time_s,t_s,acceleration_g\n0,0,0\n0.1,1,1\n", "line 1: 2 time columns"),
        ("time,acceleration_g\n0,0\n0.1,1\n", "line 1: no unit s in column 'time'; 'time_s' is required"),
        ("time_min,acceleration_g\n0,0\n0.1,1\n", "line 1: no unit s in column 'time_min'"),
        ("# c\ntime_s,acceleration\n0,0\n0.1,1\n", "line 2: no unit of acceleration in column 'acceleration'; g, m/s²"),
        ("time_s,acceleration_um_s2\n0,0\n0.1,1\n", "line 1: no unit of acceleration in column 'acceleration_um_s2'"),
        ("time_s,acceleration_g\n0,0\n0.1,nan\n", "line 3: 'nan' is not a finite number"),
        ("time_s,acceleration_g\n0,0\n0.1,\n", "line 3: '' is not a finite number"),
        ("time_s,acceleration_g\n0,0\n1 s,2\n", "line 3: '1 s' is not a finite number"),
        ("time_s,acceleration_g\n0,0\n0.1\n", "line 3: 1 cells in '0.1'; the header has 2"),
        ("time_s,acceleration_g\n0,0\n0,1,1\n", "line 3: 3 cells in '0,1,1'; the header has 2"),
        ("time_s,acceleration_g\n0,0\n", "2 rows; a header as 'time_s,acceleration_g' and two rows of numbers are"),
        ("# only a comment\n", "0 rows; a header"),
        ("time_s,acceleration_g\n0.1,0\n0.2,1\n0.3,2\n", "line 2: the first time is 0.1 s; 0 is required"),
        ("time_s,acceleration_g\n0,0\n0,1\n0,2\n", "line 3: time 0 s is 0 s after the row before; equal steps > 0"),
        ("time_s,acceleration_g\n0,0\n-0.1,1\n-0.2,2\n", "line 3: time -0.1 s is -0.1 s after the row before;"),
    ],
)
def test_bad_csv_is_refused(tmp_path: Path, text: str, problem: str) -> None:
    assert problem in refusal(csv_file(tmp_path, text))


def test_missing_row_is_named_by_its_line(tmp_path: Path) -> None:
    rows = [f"{0.02 * i:.2f},{i}" for i in range(10) if i != 6]
    message = refusal(csv_file(tmp_path, "# c\ntime_s,acceleration_g\n" + "\n".join(rows) + "\n"))
    assert message.endswith(
        "line 9: time 0.14 s is 0.04 s after the row before; equal steps > 0 are required (median 0.02 s)"
    )


def test_time_may_deviate_by_one_millionth_of_a_step(tmp_path: Path) -> None:
    def with_last_time(last: str) -> Path:
        return csv_file(tmp_path, f"time_s,acceleration_g\n0,1\n0.01,1\n0.02,1\n0.03,1\n{last},1\n")

    assert read_csv(with_last_time("0.040000009")).time_step == pytest.approx(0.01, rel=1e-6)
    assert read_csv(with_last_time("0.039999991")).time_step == pytest.approx(0.01, rel=1e-6)
    assert "line 6: time 0.040000011 s is 0.010000011 s after" in refusal(with_last_time("0.040000011"))
    assert "line 6: time 0.039999989 s is 0.009999989 s after" in refusal(with_last_time("0.039999989"))
