"""What a record says of itself is used or refused: unit, factor, quantity, processing, marks of missing values."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import read_ground_motion
from bmd_rths_core.ground_motion.catalogue import catalogue
from bmd_rths_core.ground_motion.config import GroundMotionConfig, select_ground_motion
from tests.core.field_records import GRAVITY, WAVE, assert_wave, at2, csv, refusal
from tests.core.record_samples import SAMPLES, TIME_STEP, cosmos, csmip, esm


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
