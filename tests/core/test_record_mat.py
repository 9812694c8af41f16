"""MATLAB files: read as scipy reads them, and never the end of the process when they are damaged."""

from __future__ import annotations

import io
import struct
from contextlib import suppress

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bmd_rths_core.ground_motion import read_ground_motion
from bmd_rths_core.ground_motion.catalogue import catalogue
from bmd_rths_core.ground_motion.formats.mat5 import DamagedMat, read_variables
from tests.conftest import examples
from tests.core.field_records import WAVE, assert_wave, refusal
from tests.core.record_samples import COMPONENTS, TIME, TIME_STEP, mat


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


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(300), deadline=None)
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
