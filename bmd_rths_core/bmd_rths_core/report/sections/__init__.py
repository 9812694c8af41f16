"""The sections of the report of a run, one module each: what it shows, how it is drawn, its caption and its height."""

from __future__ import annotations

from typing import Protocol

from bmd_rths_core.report.document import Block, Drawing
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.sections import (
    adaptation,
    drifts,
    energy,
    errors,
    forces,
    frequencies,
    hysteresis,
    limits,
    provenance,
    quality,
    responses,
    timing,
    tracking,
    transfer,
)


class ReportSection(Protocol):
    """What the module of a section has."""

    TITLE: str

    def blocks(self, run: ReportedRun) -> list[Block]:
        """Return what stands below the title; a figure that cannot be shown is the reason why.

        Parameters
        ----------
        run : ReportedRun
            The run.
        """


class FigureSection(ReportSection, Protocol):
    """What the module of a section with one figure has."""

    def figure(self, run: ReportedRun) -> Drawing | str:
        """Return the figure, or why there is none.

        Parameters
        ----------
        run : ReportedRun
            The run.
        """


#: From the top of the page. A further section is a module and a line here.
SECTIONS: tuple[ReportSection, ...] = (
    errors,
    quality,
    limits,
    responses,
    drifts,
    tracking,
    adaptation,
    frequencies,
    forces,
    hysteresis,
    transfer,
    energy,
    timing,
    provenance,
)
