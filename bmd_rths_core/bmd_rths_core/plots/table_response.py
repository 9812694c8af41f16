"""Drawing of the transfer function of the table (Figures 6 and 10)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bmd_rths_core.paper_figures.table_response import TableResponse
from bmd_rths_core.plots.style import BLACK, LINES, ORANGE, legend_below, new_figure

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def draw_table_response(data: TableResponse) -> Figure:
    """Draw magnitude, phase and coherence over the frequency."""
    figure = new_figure(130.0, f"Figure {data.number}. {data.title}\n{data.note}")
    magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 1))
    measured_hertz, model_hertz = data.measured.frequencies / (2.0 * np.pi), data.frequencies / (2.0 * np.pi)
    for axes, scale in ((magnitude, _decibels), (phase, _degrees)):
        measured, model = scale(data.measured.response), scale(data.model)
        axes.plot(measured_hertz, measured, color=ORANGE, linewidth=2.2, label="measured (simulated table)")
        axes.plot(model_hertz, model, color=BLACK, linewidth=0.8, label=f"model: {data.model_name}")
    constant_delay = -np.degrees(data.frequencies * data.delay)
    phase.plot(model_hertz, constant_delay, label=f"constant delay of {1e3 * data.delay:g} ms (paper)", **LINES[1])
    coherence.plot(measured_hertz, data.measured.coherence, color=BLACK, linewidth=0.8)
    if data.interaction is not None:
        hertz = data.interaction / (2.0 * np.pi)
        for axes in (magnitude, phase, coherence):
            label = f"interaction at {hertz:.2f} Hz (paper)"
            axes.axvline(hertz, color="0.3", linewidth=0.8, linestyle=":", label=label)
    magnitude.set(ylabel="magnitude [dB]", xlim=(0.0, model_hertz[-1]), xticks=range(0, round(model_hertz[-1]) + 1, 2))
    phase.set(ylabel="phase [°]")
    coherence.set(ylabel="coherence", ylim=(0.0, 1.05), xlabel="frequency [Hz]")
    figure.align_ylabels()
    legend_below(figure, phase, columns=2)
    return figure


def _decibels(response: ComplexArray) -> FloatArray:
    return np.asarray(20.0 * np.log10(np.abs(response)))


def _degrees(response: ComplexArray) -> FloatArray:
    return np.asarray(np.degrees(np.unwrap(np.angle(response))))
