"""Archives of records, and records that are damaged anywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import read_ground_motion
from bmd_rths_core.ground_motion.catalogue import catalogue
from tests.conftest import examples
from tests.core.field_records import afad, assert_wave, at2, csv, refusal, sac, smc, zipped
from tests.core.record_samples import COMPONENTS, csmip


def test_records_inside_archives_are_components(write) -> None:
    inner = zipped({"CHAN001.V2": csmip(), "readme.txt": b"of the agency"})
    path = write(zipped({"a/b.zip": inner, "x.AT2": at2().encode()}), "cesmd.zip")
    assert "must be one of" in refusal(path)
    names = [entry.component for entry in catalogue(path)]
    assert names == ["b.zip CHAN001.V2 90 DEG", "b.zip CHAN001.V2 UP", "b.zip CHAN001.V2 0 DEG", "x.AT2"]
    assert_wave(read_ground_motion(path, "x.AT2"))
    motion = read_ground_motion(path, "b.zip CHAN001.V2 UP")
    np.testing.assert_allclose(motion.acceleration, COMPONENTS[1] / 100.0, atol=1e-14)


@pytest.mark.slow
def test_archive_that_grows_is_refused(write) -> None:
    assert "100 MB inside" in refusal(write(zipped({"zeros.txt": bytes(120_000_000)})))


def test_archive_without_a_record_is_refused(write) -> None:
    assert "without a ground motion" in refusal(write(zipped({"readme.txt": b"hello"})))
    assert "a damaged archive" in refusal(write(zipped({"readme.txt": b"hello"})[:-30]))


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(150), deadline=None)
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
