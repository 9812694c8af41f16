"""Reader of miniSEED, by ObsPy, which is installed with ``pip install bmd_rths_core[obspy]``."""

from __future__ import annotations

import importlib
import io
import re

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat


def _recognises(file: RecordFile) -> bool:
    return re.match(rb"[0-9]{6}[DRQM][ \0]", file.content) is not None or file.content.startswith(b"MS\x03")


def _channels(file: RecordFile) -> list[Channel]:
    try:
        obspy = importlib.import_module("obspy")
    except ModuleNotFoundError:
        raise InputError(
            f"{file.path}: miniSEED; ObsPy is required to read it: pip install bmd_rths_core[obspy]"
        ) from None
    try:
        stream = obspy.read(io.BytesIO(file.content), format="MSEED")
    except Exception as error:  # of a damaged file ObsPy raises what it happens to run into
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{file.path}: damaged miniSEED: {problem[:200]}") from error
    ids = [trace.id for trace in stream]
    double = next((name for name in ids if ids.count(name) > 1), None)
    if double is not None:
        raise InputError(f"{file.path}: {double} has {ids.count(double)} pieces with gaps between; one is required")
    return [
        Channel(trace.stats.channel, float(trace.stats.delta), np.asarray(trace.data, dtype=np.float64), None)
        for trace in stream
    ]


MINISEED = RecordFormat("miniSEED", (".mseed", ".miniseed"), _recognises, _channels)
