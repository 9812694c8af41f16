"""Reader of ASDF, seismological records in HDF5, by h5py, which is installed with ``bmd_rths_core[asdf]``."""

from __future__ import annotations

import importlib.util
import io
import subprocess
import sys

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat

_SIGNATURE = b"\x89HDF\r\n\x1a\n"

#: Longest time a file may take [s].
_LONGEST = 60.0

# A damaged file may end the process that reads it inside the HDF5 library, so another process does.
_READ = """
import io, sys, h5py, numpy
file = h5py.File(io.BytesIO(sys.stdin.buffer.read()), "r")
if file.attrs.get("file_format") not in ("ASDF", b"ASDF"):
    sys.exit("an HDF5 file, but no ASDF")
arrays = {}
for station in file["Waveforms"].values():
    for name, values in station.items():
        if name != "StationXML":
            arrays[f"{name.partition('__')[0]} {len(arrays)} {float(values.attrs['sampling_rate'])!r}"] = values[:]
out = io.BytesIO()
numpy.savez(out, **arrays)
sys.stdout.buffer.write(out.getvalue())
"""


def _recognises(file: RecordFile) -> bool:
    return file.content.startswith(_SIGNATURE)


def _channels(file: RecordFile) -> list[Channel]:
    if _SIGNATURE not in file.content:  # it may stand behind a block of somebody else
        raise InputError(f"{file.path}: damaged, or no ASDF: nothing in it begins as an HDF5 file does")
    if importlib.util.find_spec("h5py") is None:
        raise InputError(f"{file.path}: HDF5; h5py is required to read ASDF: pip install bmd_rths_core[asdf]")
    channels = []
    for key, values in _waveforms(file).items():
        name, _, rate_text = key.rsplit(" ", 2)
        rate = float(rate_text)
        if values.ndim != 1 or values.dtype.kind not in "fiu" or not 0.0 < rate < 1e6:
            raise InputError(
                f"{file.path}: {name}: shape {values.shape} at {rate:g} Hz; one row at a rate > 0 is required"
            )
        # A step of so few digits: 1/200 is 0.005.
        channel = Channel(
            name, float(f"{1.0 / rate:.9g}"), values.astype(np.float64), None, alias=name.rpartition(".")[2]
        )
        channels.append(channel)
    names = [channel.component for channel in channels]
    double = next((name for name in names if names.count(name) > 1), None)
    if double is not None:
        raise InputError(f"{file.path}: {double} has {names.count(double)} pieces with gaps between; one is required")
    return channels


def _waveforms(file: RecordFile) -> dict[str, np.ndarray]:
    """Return the waveforms by name, place and sampling rate."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", _READ], input=file.content, capture_output=True, timeout=_LONGEST, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{file.path}: ASDF; not read within {_LONGEST:g} s") from None
    if done.returncode == 0:
        with np.load(io.BytesIO(done.stdout)) as arrays:
            return dict(arrays)
    words = done.stderr.decode("utf-8", "replace").split("\n")
    problem = next((line for line in reversed(words) if line.strip()), "")
    if done.returncode < 0:
        problem = f"the HDF5 library ended with signal {-done.returncode}"
    raise InputError(f"{file.path}: damaged, or no ASDF: {' '.join(problem.split())[:200]}")


ASDF = RecordFormat("ASDF", (".asdf", ".h5"), _recognises, _channels)
