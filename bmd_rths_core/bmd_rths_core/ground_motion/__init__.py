"""Ground motions: read recorded accelerations and bring them to the time step and the strength of a test."""

from bmd_rths_core.ground_motion.formats.at2 import read_at2
from bmd_rths_core.ground_motion.formats.cosmos import read_cosmos
from bmd_rths_core.ground_motion.formats.csmip import read_csmip
from bmd_rths_core.ground_motion.formats.csv_columns import read_csv
from bmd_rths_core.ground_motion.formats.cwa import read_cwa
from bmd_rths_core.ground_motion.formats.esm import read_esm
from bmd_rths_core.ground_motion.formats.geonet import read_geonet
from bmd_rths_core.ground_motion.formats.jma import read_jma
from bmd_rths_core.ground_motion.formats.knet import read_knet
from bmd_rths_core.ground_motion.formats.mat import read_mat
from bmd_rths_core.ground_motion.formats.simcenter import read_simcenter
from bmd_rths_core.ground_motion.library import read_ground_motion, shipped_records
from bmd_rths_core.ground_motion.motion import STANDARD_GRAVITY, GroundMotion
from bmd_rths_core.ground_motion.processing import (
    fade_in,
    high_pass,
    interpolate,
    pad,
    resample,
    scale_time,
    scale_to_peak,
    truncate,
)

__all__ = [
    "STANDARD_GRAVITY",
    "GroundMotion",
    "fade_in",
    "high_pass",
    "interpolate",
    "pad",
    "read_at2",
    "read_cosmos",
    "read_csmip",
    "read_csv",
    "read_cwa",
    "read_esm",
    "read_geonet",
    "read_ground_motion",
    "read_jma",
    "read_knet",
    "read_mat",
    "read_simcenter",
    "resample",
    "scale_time",
    "scale_to_peak",
    "shipped_records",
    "truncate",
]
