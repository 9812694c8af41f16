"""Values that are no ground motion, and files that are not whole, are refused."""

from __future__ import annotations

import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import read_ground_motion
from bmd_rths_core.ground_motion.config import GroundMotionConfig, select_ground_motion
from tests.core.field_records import WAVE, assert_wave, at2, csv, refusal
from tests.core.record_samples import SAMPLES, knet

# ---- plausibility


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


# ---- completeness


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
