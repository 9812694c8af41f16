"""How the table followed over frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_rgba

from bmd_rths_core.analysis.recorded_response import recorded_response
from bmd_rths_core.identification.frequency_response import FrequencyResponse
from bmd_rths_core.plots.layout import Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLACK, BLUE
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.document import Block, shown
from bmd_rths_core.report.reported_run import ReportedRun, part

TITLE = "Tracking over frequency"

CAPTION = (
    "From the desired to the achieved acceleration. Each point is as dark as it is coherent: pale ones say nothing."
)


@dataclass(frozen=True)
class TableFrequencies:
    """Frequency response from the desired to the achieved acceleration, and how far it can be trusted.

    Parameters
    ----------
    response : FrequencyResponse
        Estimated with Hann windows and averaged spectra.
    """

    response: FrequencyResponse

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 105.0

    def draw(self, figure: Canvas) -> None:
        """Draw magnitude, phase and coherence; what is less coherent is paler."""
        grid = grid_in_mm(figure, 3, height_ratios=(2, 2, 1))
        magnitude, phase, coherence = grid.subplots(squeeze=False, sharex=True)[:, 0]
        found = self.response
        hertz = found.frequencies / (2.0 * np.pi)
        shade = [to_rgba(BLUE, alpha) for alpha in np.clip(found.coherence, 0.02, 1.0) ** 2]
        magnitude.scatter(hertz, 20.0 * np.log10(np.maximum(np.abs(found.response), 1e-3)), s=5.0, c=shade)
        phase.scatter(hertz, np.degrees(np.angle(found.response)), s=5.0, c=shade)
        coherence.plot(hertz, found.coherence, color=BLACK, linewidth=0.8)
        for axes, label in ((magnitude, "magnitude [dB]"), (phase, "phase [°]")):
            axes.axhline(0.0, color="0.5", linewidth=0.6)
            axes.set_ylabel(label)
        phase.set(ylim=(-180.0, 180.0), yticks=range(-180, 181, 90))
        coherence.set(ylabel="coherence", ylim=(0.0, 1.05), xlim=(0.0, hertz[-1]), xlabel="frequency [Hz]")


def table_frequencies(record: RunRecord) -> TableFrequencies:
    """Return how the table followed in frequency.

    Parameters
    ----------
    record : RunRecord
        The run; gaps are bridged by straight lines.

    Raises
    ------
    InputError
        The record is too short, or the table was not moved.
    """
    return TableFrequencies(recorded_response(record.desired_acceleration[1:], record.table_acceleration[:-1], record))


def figure(run: ReportedRun) -> TableFrequencies | str:
    """Return the figure of a run, or why there is none."""
    return part(run.no_table, lambda: table_frequencies(run.record))


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    return [shown(figure(run), CAPTION)]
