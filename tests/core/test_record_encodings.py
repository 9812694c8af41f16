"""Records in every encoding of text, with blank lines above, and with keys in any case."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bmd_rths_core.ground_motion import read_ground_motion
from tests.core.field_records import assert_wave, at2
from tests.core.record_samples import COMPONENTS, SAMPLES


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
