"""The earthquake of a test: which record, how it is scaled and how long it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.formats.record_format import UNIT_CHOICES
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE, ONLY
from bmd_rths_core.ground_motion.library import read_ground_motion
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.ground_motion.processing import (
    check_time_step,
    divide_each_other,
    fade_in,
    high_pass,
    interpolate,
    pad,
    resample,
    scale_time,
    scale_to_peak,
    truncate,
)
from bmd_rths_core.parameters import check_parameters, parameter


@dataclass(frozen=True)
class GroundMotionConfig:
    """The earthquake."""

    SECTION: ClassVar[str] = "ground_motion"

    record: str = parameter(
        "el_centro_1940_ns", description="Path of a ground-motion record, or the name of a record that is shipped"
    )
    component: str = parameter(
        ONLY, description="Component of a file with several, as the file names it; only for a file with one"
    )
    unit: str = parameter(
        FROM_FILE, description="Unit of the accelerations in a file that does not state it", choices=UNIT_CHOICES
    )
    record_time_step: float = parameter(
        0.0,
        description="Time step of a record whose file does not state it, 0 for all others",
        unit="s",
        lower=0.0,
        upper=1.0,
    )
    columns: str = parameter(
        FROM_FILE,
        description="What the columns of a file of numbers are, with commas between: time, the name of a component, or "
        "- for one that is passed over; series for one series over all lines; from_file for all other files",
    )
    resample: bool = parameter(
        False,
        description="Bring a record to the time step of the loop by band-limited interpolation, also where the two "
        "time steps do not divide each other",
        source="docs/reference/ground_motions.md",
    )
    peak_acceleration: float = parameter(
        1.0,
        description="Peak the record is scaled to, 0 for the record as it is",
        unit="m/s2",
        source="Chen et al. 2020: 1.0 m/s2",
        lower=0.0,
        upper=50.0,
    )
    duration: float = parameter(
        0.0,
        description="Length of the record that is used, as it is run; 0 for all of it",
        unit="s",
        lower=0.0,
        upper=3600.0,
    )
    high_pass_frequency: float = parameter(
        0.0,
        description="Baseline correction: zero-phase Butterworth high-pass at a frequency of the record before "
        "time_scale; brings the time it needs before and after the record; 0 for the record as it is",
        unit="Hz",
        source="Boore & Bommer 2005",
        lower=0.0,
        upper=10.0,
    )
    time_scale: float = parameter(
        1.0,
        description="Factor on the time axis of the record; below 1 for a specimen that is a model of something larger",
        unit="1",
        source="similitude: square root of the length scale",
        lower=0.01,
        upper=100.0,
    )
    fade_in: float = parameter(
        0.0,
        description="Time over which the record itself begins, as a raised cosine; with high_pass_frequency it comes "
        "before the filter; 0 for a record that begins at rest",
        unit="s",
        source="docs/decisions/0009",
        lower=0.0,
        upper=600.0,
    )
    free_vibration: float = parameter(
        0.0, description="Time at rest of the ground after the record", unit="s", lower=0.0, upper=600.0
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)
        if not self.record:
            raise InputError("ground_motion.record: empty; a path or the name of a shipped record is required")
        if not self.columns:
            raise InputError(
                f"ground_motion.columns: empty; names are required, {FROM_FILE!r} for a file that has them"
            )
        if not self.component:
            raise InputError(
                f"ground_motion.component: empty; a name is required, {ONLY!r} for a file with one component"
            )


def select_ground_motion(config: GroundMotionConfig, time_step: float) -> GroundMotion:
    """Return the ground motion of a test, ready for the loop.

    The record is read, stretched or compressed in time, shortened, high-pass filtered, resampled to the time step,
    faded in (before a high-pass, which brings rest before the record), scaled and followed by rest. Scaling comes after
    resampling and fading, so that the peak the loop sees is exactly the one asked for.

    Parameters
    ----------
    config : GroundMotionConfig
        What is asked for.
    time_step : float
        Δt of the loop [s].

    Returns
    -------
    GroundMotion
        One sample a step.

    Raises
    ------
    InputError
        The record cannot be read, its component or unit is missing, its time step and Δt do not divide each other
        (before or after the time scale), or it is shorter than its fade-in.
    """
    return prepare_ground_motion(read_configured(config), config, time_step)


def read_configured(config: GroundMotionConfig) -> GroundMotion:
    """Return the record of a configuration as its file has it.

    Parameters
    ----------
    config : GroundMotionConfig
        What is asked for.

    Raises
    ------
    InputError
        The record cannot be read, or its component or unit is missing.
    """
    return read_ground_motion(
        config.record,
        config.component,
        config.unit,
        time_step=config.record_time_step,
        columns=config.columns,
        high_pass=config.high_pass_frequency > 0.0,
    )


def prepare_ground_motion(motion: GroundMotion, config: GroundMotionConfig, time_step: float) -> GroundMotion:
    """Return a record that has been read as `select_ground_motion` does.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    config : GroundMotionConfig
        What is asked for.
    time_step : float
        Δt of the loop [s].

    Returns
    -------
    GroundMotion
        One sample a step.

    Raises
    ------
    InputError
        It is shorter than asked for, or its time step and Δt divide each other neither before nor after the time scale.
    """
    recorded, motion = motion, scale_time(motion, config.time_scale)
    if config.duration > 0.0:
        motion = truncate(motion, config.duration)
    filtered = config.high_pass_frequency > 0.0
    if filtered:
        # It brings rest before the record: faded after it, the rest would be faded and the record begin as it does.
        if config.fade_in > 0.0:
            motion = fade_in(motion, config.fade_in)
        motion = high_pass(motion, config.high_pass_frequency / config.time_scale)
    if divide_each_other(motion.time_step, time_step):
        motion = resample(motion, time_step)
    else:  # a time scale has no reason to fit the time step of the loop, a record has
        if not config.resample:
            check_time_step(recorded, time_step)
        motion = interpolate(motion, time_step)
    if config.fade_in > 0.0 and not filtered:
        motion = fade_in(motion, config.fade_in)
    if config.peak_acceleration > 0.0:
        motion = scale_to_peak(motion, config.peak_acceleration)
    # A record is cut at one of its points; the test lasts as long as was asked for.
    return pad(motion, max(motion.duration, config.duration) + config.free_vibration)
