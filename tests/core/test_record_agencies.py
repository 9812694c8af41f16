"""Formats of agencies: SMC, SAC, the old text of AFAD, ASDF."""

from __future__ import annotations

import numpy as np
import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import read_ground_motion
from tests.core.field_records import WAVE, afad, asdf, assert_wave, refusal, sac, smc

# ---- SMC


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


# ---- SAC


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


# ---- AFAD


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


# ---- ASDF


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
