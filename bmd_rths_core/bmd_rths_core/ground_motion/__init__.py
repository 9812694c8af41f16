"""Ground motions: read recorded accelerations and bring them to the time step and the strength of a test."""

from bmd_rths_core.ground_motion.at2 import read_at2
from bmd_rths_core.ground_motion.csv_reader import read_csv
from bmd_rths_core.ground_motion.library import read_ground_motion, shipped_records
from bmd_rths_core.ground_motion.motion import STANDARD_GRAVITY, GroundMotion
from bmd_rths_core.ground_motion.processing import pad, resample, scale_to_peak, truncate

__all__ = [
    "STANDARD_GRAVITY",
    "GroundMotion",
    "pad",
    "read_at2",
    "read_csv",
    "read_ground_motion",
    "resample",
    "scale_to_peak",
    "shipped_records",
    "truncate",
]
