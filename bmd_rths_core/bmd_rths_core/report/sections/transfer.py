"""Amplification of the ground acceleration by the floors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.recorded_response import recorded_response
from bmd_rths_core.identification.frequency_response import FrequencyResponse
from bmd_rths_core.plots.layout import Canvas, grid_in_mm, legend_on_top
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.document import Block, shown
from bmd_rths_core.report.reported_run import ReportedRun, part
from bmd_rths_core.report.sections.responses import REFERENCE, RUN

FloatArray = NDArray[np.float64]

TITLE = "Transfer functions"

CAPTION = "Amplification of the ground acceleration, estimated in the same way from the run and from the reference."

#: What is less coherent may leave the figure: noise has no amplification.
_COHERENT = 0.3


@dataclass(frozen=True)
class FloorTransfer:
    """Frequency responses from the ground to the floors, in the run and in the reference.

    Parameters
    ----------
    names : tuple of str
        The n floors.
    run, reference : FrequencyResponse
        Of n responses each, both estimated from the record in the same way.
    """

    names: tuple[str, ...]
    run: FrequencyResponse
    reference: FrequencyResponse

    @property
    def height(self) -> float:
        """Height [mm]."""
        return min(20.0 + 32.0 * len(self.names), 250.0)

    def draw(self, figure: Canvas) -> None:
        """Draw the amplification from the ground to the floors, top floor first."""
        grid = grid_in_mm(figure, len(self.names), top=11.0, between=(7.0, 0.0))
        rows = grid.subplots(squeeze=False, sharex=True)[:, 0]
        hertz = self.run.frequencies / (2.0 * np.pi)
        for axes, floor in zip(rows, reversed(range(len(self.names))), strict=True):
            for response, look in ((self.run, RUN), (self.reference, REFERENCE)):
                axes.semilogy(hertz, np.maximum(np.abs(response.response[:, floor]), 1e-3), **look)
            coherent = self.run.coherence[:, floor] >= _COHERENT
            run = np.abs(self.run.response[coherent, floor])
            shown = np.maximum(np.append(np.abs(self.reference.response[:, floor]), run), 1e-3)
            axes.set(ylabel="[1]", ylim=(0.5 * shown.min(), 2.0 * shown.max()))
            axes.yaxis.set_major_formatter("{x:g}")  # powers would be formulas, which are not parsed
            axes.yaxis.set_minor_formatter("")
            axes.set_title(f"{self.names[floor]} over ground", loc="left")
        rows[-1].set(xlabel="frequency [Hz]", xlim=(0.0, hertz[-1]))
        legend_on_top(figure, rows[0], 2)


def floor_transfer(record: RunRecord, reference: FloatArray, lower: int) -> FloorTransfer:
    """Return the frequency responses of the interface and the measured floors.

    Parameters
    ----------
    record : RunRecord
        The run; gaps are bridged by straight lines.
    reference : ndarray, shape (N, n)
        Absolute acceleration of every floor of the whole building [m/s²].
    lower : int
        Stories of the numerical substructure.

    Raises
    ------
    InputError
        The record is too short, or the ground was at rest.
    """
    measured = record.floor_accelerations
    run = np.column_stack((record.desired_acceleration[1:], measured[:-1]))
    names = ("interface", *(f"specimen floor {i + 1}" for i in range(measured.shape[1])))
    ground = record.ground_acceleration[1:]
    shown = reference[1:, lower - 1 : lower + measured.shape[1]]
    return FloorTransfer(names, recorded_response(ground, run, record), recorded_response(ground, shown, record))


def figure(run: ReportedRun) -> FloorTransfer | str:
    """Return the figure of a run, or why there is none."""
    return part(run.no_floors, lambda: floor_transfer(run.record, run.analysis.reference, run.analysis.lower))


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    return [shown(figure(run), CAPTION)]
