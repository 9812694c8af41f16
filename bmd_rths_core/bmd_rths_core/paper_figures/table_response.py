"""Transfer function of the table with the specimen on it, measured in an identification run (Figures 6 and 10)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.excitation import ExcitationSettings, excitation_command
from bmd_rths_core.identification.excited_table import DrivingStopped, drive
from bmd_rths_core.identification.frequency_response import (
    FrequencyResponse,
    estimate_frequency_response,
    without_hold,
)
from bmd_rths_core.loop.build import make_supervisor, make_table_controller
from bmd_rths_core.paper_figures.stated_value import Comparison
from bmd_rths_core.paper_figures.systems import EIGHT_STORY, SIMPLIFIED, PaperSystem, table_name
from bmd_rths_core.stability.loop_elements import Delay
from bmd_rths_core.stability.models import simulated_table

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

#: Band that is measured and shown, and the one in which the delay of a phase is taken [rad/s].
SHOWN_BAND = (2.0 * np.pi * 0.5, 2.0 * np.pi * 20.0)
DELAY_BAND = (2.0 * np.pi * 0.5, 2.0 * np.pi * 8.0)

#: Excitation of the identification run. Assumed, the paper does not give its own.
_EXCITATION = ExcitationSettings(
    kind="noise", band=(2.0 * np.pi * 0.5, 2.0 * np.pi * 25.0), amplitude=2.0, duration=300.0, seed=0, stroke=0.25
)

#: Frequencies at which the model is drawn; its sharpest resonance is several of them wide.
_POINTS = 2001


@dataclass(frozen=True)
class TableResponse:
    """What Figure 6 or 10 shows.

    Parameters
    ----------
    number : int
        Number of the figure.
    title : str
        What is shown.
    model_name : str
        What the model is called.
    note : str
        What a reader has to know about the measurement and the model; one line or two.
    measured : FrequencyResponse
        From the command to the achieved acceleration, in the `SHOWN_BAND`.
    frequencies : ndarray, shape (n,)
        Frequencies of the model, closer than the measured ones [rad/s].
    model : ndarray of complex, shape (n,)
        The model there.
    delay : float
        Constant delay the paper states [s].
    interaction : float or None
        Frequency of the interaction with the specimen the paper states [rad/s].
    comparisons : tuple of Comparison
        Computed numbers beside those of the paper.
    """

    number: int
    title: str
    model_name: str
    note: str
    measured: FrequencyResponse
    frequencies: FloatArray
    model: ComplexArray
    delay: float
    interaction: float | None
    comparisons: tuple[Comparison, ...]


def figure_6(config: Config, progress: Callable[[float], None] | None = None) -> TableResponse:
    """Return Figure 6: the table with the specimen of the 8-story system.

    Parameters
    ----------
    config : Config
        The 8-story system.
    progress : callable, optional
        Called with the finished share of the work, from 0 to 1.

    Returns
    -------
    TableResponse
    """
    interaction = 2.0 * np.pi * 8.98
    return _figure(6, EIGHT_STORY, config, 0.026, interaction, "", progress)


def figure_10(config: Config, progress: Callable[[float], None] | None = None) -> TableResponse:
    """Return Figure 10: the table with the specimen of the simplified system.

    Parameters
    ----------
    config : Config
        The simplified system.
    progress : callable, optional
        Called with the finished share of the work, from 0 to 1.

    Returns
    -------
    TableResponse
    """
    note = "\nthe coefficients of the table are assumed, the paper gives none"
    return _figure(10, SIMPLIFIED, config, 0.025, None, note, progress)


def measure_table(config: Config, progress: Callable[[float], None] | None = None) -> FrequencyResponse:
    """Drive the configured table with band-limited noise and estimate its transfer function.

    Parameters
    ----------
    config : Config
        The whole configuration; `run.seed` is the seed of the excitation and of the sensor noise.
    progress : callable, optional
        Called with the finished share of the work, from 0 to 1.

    Returns
    -------
    FrequencyResponse
        From the command to the achieved acceleration, without the hold of the command.

    Raises
    ------
    InputError
        The excitation passes a limit of the command.
    """
    step = config.run.time_step
    commands = excitation_command(replace(_EXCITATION, seed=config.run.seed), step)
    table, supervisor = make_table_controller(config), make_supervisor(config)
    told = None if progress is None else lambda steps: progress(steps / len(commands))
    try:
        responses = drive(table, supervisor, commands, step, told)
    except DrivingStopped as trip:
        raise InputError(f"identification run of {_EXCITATION.amplitude:g} m/s2: {trip}") from trip
    return without_hold(estimate_frequency_response(responses.command, responses.table, step), step)


def equivalent_delay(frequencies: FloatArray, response: ComplexArray) -> float:
    """Return the constant delay whose phase is nearest to that of a response, by least squares in `DELAY_BAND`.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        Ascending, from near zero on [rad/s].
    response : ndarray of complex, shape (n,)
        Frequency response.

    Returns
    -------
    float
        [s].
    """
    inside = (frequencies >= DELAY_BAND[0]) & (frequencies <= DELAY_BAND[1])
    omega, phase = frequencies[inside], np.unwrap(np.angle(response))[inside]
    return float(-(omega @ phase) / (omega @ omega))


def _figure(
    number: int,
    system: PaperSystem,
    config: Config,
    delay: float,
    interaction: float | None,
    note: str,
    progress: Callable[[float], None] | None,
) -> TableResponse:
    measured = measure_table(config, progress).between(*SHOWN_BAND)
    omega = np.linspace(0.0, SHOWN_BAND[1], _POINTS)
    table = simulated_table(config.simulated_table, config.simulated_table.specimen(config.specimen.building()))
    model = table.response(omega) * Delay(config.simulated_table.command_delay).response(omega)
    noise = config.simulated_table.acceleration_noise
    stated = f"{1e3 * delay:g} ms"
    band = " to ".join(f"{frequency / (2.0 * np.pi):g}" for frequency in DELAY_BAND) + " Hz"
    measured_delay = equivalent_delay(measured.frequencies, measured.response)
    comparisons = [
        Comparison(f"delay of the model, {band}", 1e3 * equivalent_delay(omega, model), "ms", stated),
        Comparison(f"delay as measured, {band}", 1e3 * measured_delay, "ms", stated),
    ]
    if interaction is not None:
        natural = np.abs(table.poles)
        pole = float(natural[np.argmin(np.abs(natural - interaction))]) / (2.0 * np.pi)
        comparisons.append(Comparison("nearest natural frequency of the model", pole, "Hz", "interaction at 8.98 Hz"))
    return TableResponse(
        number=number,
        title=f"Transfer function of the table with the specimen of the {system.name}",
        model_name=table_name(config),
        note=f'"measured" is simulated: band-limited noise up to {_EXCITATION.amplitude:g} m/s² for '
        f"{_EXCITATION.duration:g} s, sensor noise of {noise:g} m/s² RMS{note}",
        measured=measured,
        frequencies=omega,
        model=model,
        delay=delay,
        interaction=interaction,
        comparisons=tuple(comparisons),
    )
