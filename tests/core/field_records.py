"""Records as strangers have them, made here: 200 points of a wave in many formats."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import GroundMotion, read_ground_motion

#: 200 points of a wave in g.
WAVE = 0.2 * np.sin(2 * np.pi * 1.7 * 0.005 * np.arange(200))
GRAVITY = 9.80665


def at2(
    heading: str = "ACCELERATION TIME SERIES IN UNITS OF G",
    size: str = "NPTS=    200, DT=   .0050 SEC",
    values: np.ndarray = WAVE,
) -> str:
    cells = [f"{value:15.7E}" for value in values]
    rows = ["".join(cells[i : i + 5]) for i in range(0, len(cells), 5)]
    return "\n".join(["PEER NGA STRONG MOTION DATABASE RECORD", "Somewhere, 1/1/2000, X, 67", heading, size, *rows, ""])


def csv(header: str = "time_s,acceleration_g", separator: str = ",", columns: int = 1) -> str:
    rows = [separator.join([f"{0.005 * i:.3f}"] + [f"{v:.8f}"] * columns) for i, v in enumerate(WAVE)]
    return "\n".join([header, *rows, ""])


def smc(title: str = "2 CORRECTED ACCELEROGRAM", values: np.ndarray = 100 * WAVE) -> str:
    integers, reals = np.full(48, -32768), np.full(50, 1.7e38)
    integers[15], integers[16], reals[1] = 2, len(values), 200.0
    lines = [title, *["*"] * 10]
    lines += ["".join(f"{n:10d}" for n in integers[i : i + 8]) for i in range(0, 48, 8)]
    lines += ["".join(f"{x:15.7E}" for x in reals[i : i + 5]) for i in range(0, 50, 5)]
    lines += ["| made up", "|"]
    lines += ["".join(f"{x:10.4f}" for x in values[i : i + 8]) for i in range(0, len(values), 8)]
    return "\n".join([*lines, ""])


def sac(order: str = "<", quantity: int = 8, values: np.ndarray = WAVE) -> bytes:
    floats, words = [-12345.0] * 70, [-12345] * 40
    floats[0] = 0.005
    words[76 - 70], words[79 - 70], words[85 - 70], words[86 - 70], words[105 - 70] = 6, len(values), 1, quantity, 1
    names = b"-12345  " * 24
    names = names[:160] + b"HNE     " + names[168:]
    head = struct.pack(f"{order}70f", *floats) + struct.pack(f"{order}40i", *words) + names[:192]
    return head + values.astype(f"{order}f4").tobytes()


def afad(values="", header="", names="     N-S         E-W         U-D     ", peaks="RAW PGA VALUES (gal)", points=60):
    """Return an old AFAD file, as its readers elsewhere describe it: raw values in gal."""
    rows = values or "".join(f"{10 * np.sin(0.3 * i):12.6f}{5 * np.cos(0.3 * i):12.6f}{i:12.6f}\n" for i in range(60))
    return (
        "STRONG GROUND MOTION RECORDS OF TURKIYE\nPLACE\t:\tDÜZCE METEOROLOJI MÜDÜRLÜGÜ\n"
        "EARTHQUAKE DATE\t:\t17/08/1999 00:01:39.07 (GMT)\nEPICENTER COORDINATES : 40.75000N - 29.86000E\n"
        f"{header}NUMBER OF DATA\t:\t{points}\nSAMPLING INTERVAL(sec)\t:\t0.010000\n"
        f"{peaks}\t:\t(N-S) 9.99 (E-W) 5.00 (U-D) 59.00\n\nBy using these data you agree\n\n{names}\n{rows}"
    ).encode("latin-1")


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


def zipped(files: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return stream.getvalue()


def refusal(path: Path, **options: object) -> str:
    """Return the one line a file is refused with, behind its path."""
    with pytest.raises(InputError) as caught:
        read_ground_motion(path, **options)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    return message.removeprefix(f"{path}: ")


def assert_wave(motion: GroundMotion, unit: float = GRAVITY) -> None:
    assert (motion.steps, motion.time_step) == (200, pytest.approx(0.005, rel=1e-12))
    np.testing.assert_allclose(motion.acceleration, WAVE * unit, atol=1e-7 * unit)
