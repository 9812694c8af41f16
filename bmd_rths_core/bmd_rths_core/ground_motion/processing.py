"""Bring a ground motion to the time step, the strength and the length of a test."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.motion import GroundMotion

#: Largest ratio of two time steps in `resample`; beyond it a unit has been mistaken (0.005 s for 5 ms).
MAX_RATIO = 500

# Kaiser's formula N - 1 = (A - 7.95) / (2.285 Δω) for a transition band of 0.2 of the lower Nyquist frequency gives
# 25.8 points of the coarser record on each side (Oppenheim & Schafer, Discrete-Time Signal Processing, Eq. 7.76). It is
# an approximation: 2 dB more are designed than `resample` promises.
_DESIGN_ATTENUATION = 82.0
_HALF_WIDTH = 26

_RATIO_TOLERANCE = 1e-9

#: Smallest peak that is scaled to another [m/s²]: below it is the noise of the ground itself (Peterson 1993, New
#: High-Noise Model, USGS Open-File Report 93-322: some 1e-6 m/s² in the band of a shake table).
SMALLEST_PEAK = 1e-6

#: What is left of a constant by the rounding of `high_pass`, as a part of it, with a margin.
ROUNDING = 1e-11

MAX_EXTENSION = 5_000_000  #: Most points `high_pass` extends a record by at each end.
#: Order of the Butterworth filter of `high_pass`, both directions together.
_HIGH_PASS_ORDER = 4


def resample(motion: GroundMotion, time_step: float) -> GroundMotion:
    """Change the time step by a whole factor, without phase shift and without aliasing.

    Both directions use a Kaiser-windowed sinc of odd length, applied symmetrically, so that the phase is zero. With
    f_N the Nyquist frequency of the coarser time step, amplitudes up to the pass-band edge are kept within 0.01 %
    (-80 dB), and what lies beyond the stop-band edge comes out at less than 0.01 %:

    ==========  ===============  ==============  ============================================================
    direction   pass band up to  stop band from  what the stop band removes
    ==========  ===============  ==============  ============================================================
    finer       0.9 f_N          1.1 f_N         images of the spectrum
    coarser     0.8 f_N          1.0 f_N         what would fold back (alias) into the new record
    ==========  ===============  ==============  ============================================================

    The finer filter is a Nyquist filter: the given points are kept exactly, and the new ones lie between them. The
    record is taken as zero before its first and after its last point; where it does not begin or end at rest, the
    step there rings over 26 points of the coarser record.

    Parameters
    ----------
    motion : GroundMotion
        A record of N points.
    time_step : float
        The time step wanted [s]. It must be a whole multiple or a whole fraction of that of the record, up to 500.

    Returns
    -------
    GroundMotion
        ``(N - 1) * L + 1`` points for a step L times finer, ``ceil(N / M)`` for one M times coarser.

    Raises
    ------
    InputError
        Neither time step is a whole multiple of the other, or fewer than two points would be left.
    """
    finer, coarser = _ratio(motion, time_step)
    if finer > 1:
        acceleration = _interpolate(motion.acceleration, _nyquist_filter(finer), finer)
        start, steps = finer * _HALF_WIDTH, (motion.steps - 1) * finer + 1
    elif coarser > 1:
        acceleration = np.convolve(motion.acceleration, _low_pass(coarser, cut_off=0.9) / coarser)[::coarser]
        start, steps = _HALF_WIDTH, -(-motion.steps // coarser)
    else:
        acceleration, start, steps = motion.acceleration, 0, motion.steps
    return replace(motion, time_step=time_step, acceleration=acceleration[start : start + steps])


def interpolate(motion: GroundMotion, time_step: float) -> GroundMotion:
    """Change the time step by any factor, without phase shift and without aliasing.

    The filters are those of `resample`, taken where the new points lie: pass band and stop band are the same, but no
    given point is kept as it is.

    Parameters
    ----------
    motion : GroundMotion
        A record of N points.
    time_step : float
        The time step wanted [s], up to 500 times finer or coarser than that of the record.

    Returns
    -------
    GroundMotion
        Its points up to the last one of the record.

    Raises
    ------
    InputError
        The factor is too large, or fewer than two points would be left.
    """
    _check_positive("time step", time_step, "s")
    points = time_step / motion.time_step  # of the record in one step
    if not 1.0 / MAX_RATIO <= points <= MAX_RATIO:
        raise InputError(
            f"time step {time_step:.9g} s; ground motion {motion.name!r} has {motion.time_step:.9g} s, and a factor of "
            f"at most {MAX_RATIO} is required"
        )
    positions = points * np.arange(math.floor((motion.steps - 1) / points + _RATIO_TOLERANCE) + 1)
    nearest = np.round(positions).astype(int)
    # Steps that lie alike between the points share their taps; for a factor that is a short decimal most of them do.
    between, taps_of = np.unique(np.round(positions - nearest, 9), return_inverse=True)
    width = max(1.0, points)
    half = math.ceil(_HALF_WIDTH * width + 0.5)
    distance = (np.arange(-half, half + 1) - between[:, None]) / width
    taps = _kernel(distance, cut_off=1.0 if points <= 1.0 else 0.9) / width
    padded = np.pad(motion.acceleration, half)
    acceleration = np.zeros(len(positions))
    for j in range(2 * half + 1):
        acceleration += taps[taps_of, j] * padded[nearest + j]
    return replace(motion, time_step=time_step, acceleration=acceleration)


def scale_time(motion: GroundMotion, factor: float) -> GroundMotion:
    """Stretch or compress the time axis of a record; accelerations stay.

    A specimen of length scale 1:n under unscaled acceleration answers in 1/√n of the time of its prototype, so that
    records are compressed by 1/√n for it (similitude; Harris & Sabnis, Structural Modeling and Experimental Techniques,
    1999).

    Parameters
    ----------
    motion : GroundMotion
        The record.
    factor : float
        Duration wanted over that of the record, > 0. Velocities are multiplied by it, displacements by its square.

    Returns
    -------
    GroundMotion
        The same points with another time step.

    Raises
    ------
    InputError
        The factor is not a finite number > 0.
    """
    _check_positive("time scale", factor, "")
    return replace(motion, time_step=motion.time_step * factor)


def high_pass(motion: GroundMotion, frequency: float) -> GroundMotion:
    """Correct the baseline of a record: remove what is slower than a frequency, without phase shift.

    The record less its mean is extended with rest at both ends, by 0.75 n / f with the order n = 4 (Converse & Brady
    1992); then its spectrum is multiplied by 1 / (1 + (f / f')^n) at every frequency f', the gain of a Butterworth
    filter of order n / 2 that runs forwards and backwards. The extensions are kept: the filtered motion begins before
    the record, and cut off there it would drift again (Boore & Bommer 2005, Soil Dynamics and Earthquake Engineering
    25, 93-115).

    Parameters
    ----------
    motion : GroundMotion
        The record.
    frequency : float
        -6 dB point f of both directions together [Hz], below the Nyquist frequency of the record.

    Returns
    -------
    GroundMotion
        The record with 3 / f before and after it, rounded up to whole steps. Integrated from rest, its velocity and
        displacement come back to zero.

    Raises
    ------
    InputError
        The frequency is not > 0 and below the Nyquist frequency.
    """
    nyquist = 0.5 / motion.time_step
    if not 0.0 < frequency < nyquist:
        allowed = f"above 0 and below {nyquist:g} Hz"
        raise InputError(
            f"high-pass frequency {frequency:g} Hz; ground motion {motion.name!r} can be filtered {allowed}"
        )
    points = 0.75 * _HIGH_PASS_ORDER / (frequency * motion.time_step)
    if points > MAX_EXTENSION:
        problem = f"extends ground motion {motion.name!r} by {points:.3g} points; at most {MAX_EXTENSION} are allowed"
        raise InputError(f"high-pass frequency {frequency:g} Hz {problem}")
    extension = math.ceil(points)
    extended = np.pad(motion.acceleration - motion.acceleration.mean(), extension)
    points = 1 << (2 * len(extended)).bit_length()  # twice as long, because the transform is circular
    powers = np.fft.rfftfreq(points, motion.time_step) ** _HIGH_PASS_ORDER
    gain = powers / (powers + frequency**_HIGH_PASS_ORDER)
    filtered = np.fft.irfft(gain * np.fft.rfft(extended, points), points)[: len(extended)]
    if motion.peak > 0.0 and np.max(np.abs(filtered)) < ROUNDING * motion.peak:
        raise InputError(
            f"ground motion {motion.name!r}: constant at {motion.acceleration[0]:g} m/s²; nothing but rounding is left "
            f"of it above {frequency:g} Hz"
        )
    return replace(motion, acceleration=filtered)


def scale_to_peak(motion: GroundMotion, peak: float) -> GroundMotion:
    """Scale a record to a given peak acceleration.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    peak : float
        Largest absolute acceleration wanted [m/s²], > 0.

    Returns
    -------
    GroundMotion
        The scaled record.

    Raises
    ------
    InputError
        The peak is not a finite number > 0, or the record is zero throughout.
    """
    _check_positive("peak", peak, "m/s²")
    if 0.0 < motion.peak < SMALLEST_PEAK:
        raise InputError(
            f"ground motion {motion.name!r}: peak {motion.peak:.3g} m/s² is no ground motion but noise or rounding; "
            f"{SMALLEST_PEAK:g} m/s² or more can be scaled"
        )
    if motion.peak == 0.0:
        raise InputError(f"ground motion {motion.name!r}: zero throughout, cannot be scaled to a peak of {peak:g} m/s²")
    return replace(motion, acceleration=motion.acceleration / motion.peak * peak)


def fade_in(motion: GroundMotion, duration: float) -> GroundMotion:
    """Begin a record smoothly, where it does not begin at rest.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    duration : float
        Time T from which on the record is as it was [s], not more than its own.

    Returns
    -------
    GroundMotion
        The record times the raised cosine (1 − cos(π t / T)) / 2 before T.

    Raises
    ------
    InputError
        The duration is not finite and > 0, or is more than that of the record.
    """
    _check_positive("fade-in", duration, "s")
    if duration > motion.duration * (1.0 + _RATIO_TOLERANCE):
        allowed = f"up to {motion.duration:g} s"
        raise InputError(f"fade-in {duration:g} s; ground motion {motion.name!r} can be faded in over {allowed}")
    time = motion.time_step * np.arange(motion.steps)
    share = np.where(time < duration, 0.5 * (1.0 - np.cos(np.pi * time / duration)), 1.0)
    return replace(motion, acceleration=share * motion.acceleration)


def pad(motion: GroundMotion, duration: float) -> GroundMotion:
    """Append rest to a record, so that the structure can come to rest too.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    duration : float
        Time of the last point wanted [s], not less than that of the record; rounded up to a whole step.

    Returns
    -------
    GroundMotion
        The record followed by zeros.

    Raises
    ------
    InputError
        The duration is not finite or is less than that of the record.
    """
    _check_positive("duration", duration, "s")
    steps = math.ceil(duration / motion.time_step - _RATIO_TOLERANCE) + 1
    if steps < motion.steps:
        allowed = f"{motion.duration:g} s or more"
        raise InputError(f"duration {duration:g} s; ground motion {motion.name!r} can be padded to {allowed}")
    return replace(motion, acceleration=np.pad(motion.acceleration, (0, steps - motion.steps)))


def truncate(motion: GroundMotion, duration: float) -> GroundMotion:
    """Cut a record after a given time.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    duration : float
        Time of the last point wanted [s], not more than that of the record; rounded down to a whole step.

    Returns
    -------
    GroundMotion
        The beginning of the record.

    Raises
    ------
    InputError
        The duration is not finite, is less than one time step or is more than that of the record.
    """
    _check_positive("duration", duration, "s")
    steps = math.floor(duration / motion.time_step + _RATIO_TOLERANCE) + 1
    if not 2 <= steps <= motion.steps:
        allowed = f"{motion.time_step:g} s to {motion.duration:g} s"
        raise InputError(f"duration {duration:g} s; ground motion {motion.name!r} can be cut at {allowed}")
    return replace(motion, acceleration=motion.acceleration[:steps])


def divide_each_other(one: float, other: float) -> bool:
    """Tell whether one of two time steps is a whole multiple of the other, up to 500 times.

    Parameters
    ----------
    one, other : float
        Time steps > 0 [s].
    """
    ratio = max(one / other, other / one)
    return ratio < MAX_RATIO + 0.5 and abs(ratio - round(ratio)) <= _RATIO_TOLERANCE * ratio


def check_time_step(motion: GroundMotion, time_step: float) -> None:
    """Check that a time step and that of a record divide each other.

    Parameters
    ----------
    motion : GroundMotion
        The record.
    time_step : float
        The time step wanted [s].

    Raises
    ------
    InputError
        They do not.
    """
    _check_positive("time step", time_step, "s")
    if not divide_each_other(motion.time_step, time_step):
        raise InputError(
            f"time step {time_step:.9g} s; ground motion {motion.name!r} has {motion.time_step:.9g} s, and a whole "
            f"multiple or a whole fraction of that is required, by a factor of at most {MAX_RATIO}, or "
            "ground_motion.resample=true for band-limited interpolation"
        )


def _ratio(motion: GroundMotion, time_step: float) -> tuple[int, int]:
    """Return how many times finer and how many times coarser `time_step` is; one of the two is 1."""
    check_time_step(motion, time_step)
    finer, coarser = round(motion.time_step / time_step), round(time_step / motion.time_step)
    return max(finer, 1), max(coarser, 1)


def _low_pass(ratio: int, cut_off: float) -> NDArray[np.float64]:
    """Return a windowed sinc at the finer rate: gain `ratio`, -6 dB at `cut_off` times the lower Nyquist frequency."""
    half = ratio * _HALF_WIDTH
    return _kernel(np.arange(-half, half + 1) / ratio, cut_off)


def _kernel(position: NDArray[np.float64], cut_off: float) -> NDArray[np.float64]:
    """Return the windowed sinc at some distances from its middle, in points of the coarser record."""
    beta = 0.1102 * (_DESIGN_ATTENUATION - 8.7)  # Kaiser's β, Eq. 7.75 of the same book
    inside = np.sqrt(np.maximum(0.0, 1.0 - (position / _HALF_WIDTH) ** 2))
    window = np.where(np.abs(position) <= _HALF_WIDTH, np.i0(beta * inside) / np.i0(beta), 0.0)
    return cut_off * np.sinc(cut_off * position) * window


def _interpolate(points: NDArray[np.float64], taps: NDArray[np.float64], ratio: int) -> NDArray[np.float64]:
    """Filter the points with `ratio` − 1 zeros after each, without touching the zeros: one filter for each phase."""
    filtered = np.zeros((len(points) + 2 * _HALF_WIDTH, ratio))
    for phase in range(ratio):
        column = np.convolve(points, taps[phase::ratio])
        filtered[: len(column), phase] = column
    return filtered.ravel()


def _nyquist_filter(ratio: int) -> NDArray[np.float64]:
    taps = _low_pass(ratio, cut_off=1.0)
    # sin(kπ) is not quite zero in floating point; these zeros are what keeps the given points exactly.
    taps[::ratio] = 0.0
    taps[ratio * _HALF_WIDTH] = 1.0
    return taps


def _check_positive(what: str, value: float, unit: str) -> None:
    if not (math.isfinite(value) and value > 0):
        raise InputError(f"{what} {value:g} {unit}; a finite number > 0 is required")
