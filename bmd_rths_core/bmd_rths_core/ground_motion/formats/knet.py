"""Reader of K-NET ASCII files of the NIED, Japan; KiK-net has the same format."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bmd_rths_core.ground_motion.formats.header import Header
from bmd_rths_core.ground_motion.formats.record_file import RecordFile
from bmd_rths_core.ground_motion.formats.record_format import Channel, RecordFormat
from bmd_rths_core.ground_motion.formats.units import quoted
from bmd_rths_core.ground_motion.motion import GroundMotion

# "Sampling Freq(Hz) 100Hz": the key has 17 columns
_ENTRY = re.compile(r"([A-Za-z].{0,16})(.*)")
# "3920(gal)/6170801"
_SCALE = re.compile(r"([0-9.]{1,20})\s*\(gal\)\s*/\s*([0-9.]{1,20})", re.IGNORECASE)
# Direction numbers of KiK-net
_DIRECTIONS = {
    "1": "N-S borehole", "2": "E-W borehole", "3": "U-D borehole",
    "4": "N-S surface", "5": "E-W surface", "6": "U-D surface",
}  # fmt: skip


def read_knet(path: str | Path) -> GroundMotion:
    """Read a K-NET or KiK-net ASCII file: one component in counts, with their scale in gal.

    The counts have an offset, which the NIED says to remove: the mean of the record is subtracted, as it is for the
    peak in its header. Nothing else is corrected. (NIED, "About K-NET ASCII format", kyoshin.bosai.go.jp.)

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    GroundMotion
        The record in m/s², of mean zero.

    Raises
    ------
    InputError
        The file cannot be read, a line of the header or of the counts is wrong, or there are more or fewer counts than
        duration times sampling frequency.
    """
    return KNET.read(path)


def _recognises(file: RecordFile) -> bool:
    return file.begins_with("origin time", "scale factor")


def _channels(file: RecordFile) -> list[Channel]:
    header = Header(file, _ENTRY)
    frequency = header.positive("Sampling Freq(Hz)", unit="Hz")
    points = header.positive("Duration Time(s)") * frequency
    line_number, text = header.text("Scale Factor")
    scale = _SCALE.fullmatch(text)
    if scale is None:
        raise file.error(line_number, f"scale factor {quoted(text)}; '3920(gal)/6170801' is required")
    numerator, denominator = (file.number(line_number, number) for number in scale.groups())
    if not (numerator > 0.0 and denominator > 0.0):
        raise file.error(line_number, f"scale factor {quoted(text)}; two numbers > 0 are required")
    counts = np.array(file.numbers(header.first_line_behind))
    file.check_count(len(counts), round(points, 6), "duration times sampling frequency is")
    direction = header.text("Dir.")[1]
    with np.errstate(over="ignore", invalid="ignore"):  # what becomes infinite is refused
        # A dead channel is exactly zero: the rounding of its mean would be scaled to a peak like a signal.
        gal = (
            (counts - np.mean(counts)) * (numerator / denominator)
            if counts.size and np.ptp(counts)
            else np.zeros_like(counts)
        )
    return [Channel(_DIRECTIONS.get(direction, direction), 1.0 / frequency, gal, 0.01)]


KNET = RecordFormat("K-NET", (".knet",), _recognises, _channels)
