"""Commands that excite a band of frequencies within limited acceleration and displacement, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.frequency_response import FloatArray

EXCITATION_KINDS = ("noise", "sweep")

#: Rise at the beginning and decay at the end [s].
_TAPER = 5.0

#: Rest before and after the excitation [s], for the specimen to come to rest.
_REST_BEFORE, _REST_AFTER = 2.0, 5.0

#: Peak of the noise over its root mean square; Gaussian noise of some minutes has 4 to 5.
_CREST_FACTOR = 2.0

#: Share of the stroke that a sweep uses where the displacement limits it.
_SWEEP_STROKE = 0.5


@dataclass(frozen=True)
class ExcitationSettings:
    """What the table is excited with.

    Parameters
    ----------
    kind : str
        ``"noise"``: all frequencies of the band at all times, flat spectrum, random phase; or ``"sweep"``: one
        frequency after the other, with the same time for each octave.
    band : (float, float)
        Lowest and highest frequency [rad/s].
    amplitude : float
        Largest acceleration command [m/s²].
    duration : float
        Duration without the rest before and after [s].
    seed : int
        Seed of the noise.
    stroke : float
        Largest allowed displacement of the table [m].
    """

    kind: str = "noise"
    band: tuple[float, float] = (2.0 * np.pi * 0.5, 2.0 * np.pi * 25.0)
    amplitude: float = 2.0
    duration: float = 240.0
    seed: int = 0
    stroke: float = 0.25


def excitation_command(settings: ExcitationSettings, time_step: float) -> FloatArray:
    """Return acceleration commands from rest to rest: velocity and displacement are zero at the end.

    Parameters
    ----------
    settings : ExcitationSettings
        What to make.
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray, shape (N,)
        Acceleration command of each step [m/s²].

    Raises
    ------
    InputError
        A setting is not allowed, or the table would need more than its stroke.
    """
    _check(settings, time_step)
    steps = round(settings.duration / time_step)
    taper = _taper(steps, time_step)
    command = taper * (_noise if settings.kind == "noise" else _sweep)(settings, steps, time_step)
    command = _without_drift(command, taper)
    command *= settings.amplitude / np.max(np.abs(command))
    needed = float(np.max(np.abs(displacement_of(command, time_step))))
    if needed > settings.stroke:
        lowest = settings.band[0] / (2.0 * np.pi)
        raise InputError(
            f"excitation: {settings.amplitude:g} m/s2 from {lowest:g} Hz on needs {1e3 * needed:.0f} mm of stroke, "
            f"{1e3 * settings.stroke:.0f} mm are allowed; a smaller amplitude or a higher lowest frequency is required"
        )
    return np.pad(command, (round(_REST_BEFORE / time_step), round(_REST_AFTER / time_step)))


def displacement_of(command: FloatArray, time_step: float) -> FloatArray:
    """Return the displacement of a table that follows the held commands exactly.

    Parameters
    ----------
    command : ndarray, shape (N,)
        Acceleration command [m/s²].
    time_step : float
        Δt [s].

    Returns
    -------
    ndarray, shape (N,)
        Displacement at the end of each step [m].
    """
    velocity = time_step * np.cumsum(command)
    return np.asarray(time_step * np.cumsum(velocity - 0.5 * time_step * command))


def _check(settings: ExcitationSettings, time_step: float) -> None:
    lowest, highest = settings.band
    nyquist = np.pi / time_step
    if settings.kind not in EXCITATION_KINDS:
        raise InputError(f"excitation: {settings.kind!r} is unknown; one of {', '.join(EXCITATION_KINDS)} is required")
    if not 0.0 < lowest < highest <= 0.8 * nyquist:
        raise InputError(
            f"excitation: band {lowest / (2 * np.pi):g} to {highest / (2 * np.pi):g} Hz is not allowed; a rising band "
            f"> 0 and <= {0.8 * nyquist / (2 * np.pi):g} Hz is required"
        )
    for name, value, unit in (("amplitude", settings.amplitude, "m/s2"), ("stroke", settings.stroke, "m")):
        if not 0.0 < value < np.inf:
            raise InputError(f"excitation: {name} {value:g} is not allowed; > 0 {unit} is required")
    if not 4.0 * _TAPER <= settings.duration <= 7200.0:
        raise InputError(
            f"excitation: duration {settings.duration:g} s is not allowed; {4.0 * _TAPER:g} to 7200 s is required"
        )


def _noise(settings: ExcitationSettings, steps: int, time_step: float) -> FloatArray:
    """Return noise with a flat spectrum whose phases are changed until its peaks are low.

    Clipping and restoring the spectrum in turn: Van der Ouderaa, Schoukens and Renneboog, "Peak factor minimization
    using a time-frequency domain swapping algorithm", IEEE Trans. Instrum. Meas. 37(1), 1988.
    """
    frequencies = 2.0 * np.pi * np.fft.rfftfreq(steps, time_step)
    inside = (frequencies >= settings.band[0]) & (frequencies <= settings.band[1])
    spectrum = np.zeros(len(frequencies), dtype=complex)
    spectrum[inside] = np.exp(2j * np.pi * np.random.default_rng(settings.seed).random(np.count_nonzero(inside)))
    noise = np.fft.irfft(spectrum, steps)
    peak = _CREST_FACTOR * np.std(noise)
    for _ in range(50):
        clipped = np.fft.rfft(np.clip(noise, -peak, peak))
        spectrum[inside] = np.exp(1j * np.angle(clipped[inside]))
        noise = np.fft.irfft(spectrum, steps)
    return np.asarray(noise)


def _sweep(settings: ExcitationSettings, steps: int, time_step: float) -> FloatArray:
    """Return a logarithmic sweep, of constant displacement at first where that is the smaller one."""
    lowest, highest = settings.band
    time = time_step * (np.arange(steps) + 0.5)
    rate = np.log(highest / lowest) / settings.duration
    frequency = lowest * np.exp(rate * time)
    amplitude = np.minimum(settings.amplitude, _SWEEP_STROKE * settings.stroke * frequency**2)
    return np.asarray(amplitude * np.sin((frequency - lowest) / rate))


def _taper(steps: int, time_step: float) -> FloatArray:
    edge = round(_TAPER / time_step)
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
    return np.concatenate((rise, np.ones(steps - 2 * edge), rise[::-1]))


def _without_drift(command: FloatArray, taper: FloatArray) -> FloatArray:
    """Return the command with the smallest slow change that leaves neither velocity nor displacement."""
    centred = np.linspace(-1.0, 1.0, len(command))
    moments = np.vstack((np.ones_like(centred), centred))
    slow = taper * moments
    return np.asarray(command - np.linalg.solve(moments @ slow.T, moments @ command) @ slow)
