"""Forces at the interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.plots.histories import between, plot_history
from bmd_rths_core.plots.layout import ABOVE, LABELS, Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLACK, BLUE, ORANGE, VERMILION
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.document import Block, shown
from bmd_rths_core.report.reported_run import ReportedRun, part

FloatArray = NDArray[np.float64]

TITLE = "Forces"

CAPTION = "Shear at the interface. Unbalanced is what Eq. 11 corrects, required less estimated."

#: Length of the time in which curves that nearly agree can be told apart [s].
CLOSE = 2.0


@dataclass(frozen=True)
class InterfaceForces:
    """Shear at the interface and what was unbalanced.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s].
    required, estimated, fed_back : ndarray, shape (N,)
        Left side of Eq. 4, estimate from the sensors, and the shear that was fed back [N].
    measured : ndarray, shape (N,)
        Of load cells, NaN where there are none [N].
    unbalanced : ndarray, shape (N,)
        f_c of Eq. 11, required less estimated [N].
    feedback_scale : float
        Share of the shear that is fed back; estimate and measurement are multiplied by it.
    strong_motion : tuple of float
        Begin and end [s].
    window : tuple of float, optional
        Begin and end of what is shown closely, where that was chosen [s].
    """

    time: FloatArray
    required: FloatArray
    estimated: FloatArray
    fed_back: FloatArray
    measured: FloatArray
    unbalanced: FloatArray
    feedback_scale: float
    strong_motion: tuple[float, float]
    window: tuple[float, float] | None = None

    @property
    def closely(self) -> tuple[float, float]:
        """Begin and end of what is shown closely [s]."""
        return self.largest if self.window is None else self.window

    @property
    def largest(self) -> tuple[float, float]:
        """Begin and end of the `CLOSE` s around the largest shear that was fed back or required [s]."""
        size = np.fmax(np.abs(self.fed_back), np.abs(self.required))
        middle = float(self.time[np.nanargmax(size)]) if np.isfinite(size).any() else 0.0
        begin = max(0.0, min(middle, float(self.time[-1]) - 0.5 * CLOSE) - 0.5 * CLOSE)
        return begin, begin + CLOSE

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 150.0

    def draw(self, figure: Canvas) -> None:
        """Draw the shears in the strong motion and around the largest, and the unbalanced force over the whole run."""
        shears, zoom, unbalanced = grid_in_mm(figure, 3, between=(LABELS, 0.0)).subplots(squeeze=False)[:, 0]
        scaled = f", times {self.feedback_scale:g}" if self.feedback_scale != 1.0 else ""
        curves: tuple[tuple[FloatArray, str, dict[str, Any]], ...] = (
            (self.measured, f"load cells{scaled}", {"color": "0.7", "linewidth": 1.8}),
            (self.estimated, f"estimated (Eq. 6){scaled}", {"color": ORANGE, "linewidth": 1.3}),
            (self.required, "required (Eq. 4)", {"color": BLACK, "linewidth": 0.6}),
            (self.fed_back, "fed back", {"color": BLUE, "linewidth": 0.6, "linestyle": (0, (5, 2))}),
        )
        for values, label, look in curves:
            if np.isfinite(values).any():
                for axes, window in ((shears, self.strong_motion), (zoom, self.closely)):
                    plot_history(axes, *between(self.time, values / 1e3, window), label=label, **look)
        plot_history(unbalanced, self.time, self.unbalanced / 1e3, color=VERMILION, linewidth=0.6)
        shears.legend(ncols=4, **ABOVE)
        shears.set(ylabel="shear [kN]", xlim=self.strong_motion, xlabel="time [s], strong motion")
        shears.axvspan(*self.closely, color="0.93", linewidth=0.0)
        name = "around the largest shear" if self.window is None else "as chosen"
        zoom.set(ylabel="shear [kN]", xlim=self.closely, xlabel=f"time [s], {name}, shaded above")
        unbalanced.axvspan(*self.strong_motion, color="0.93", linewidth=0.0)
        unbalanced.set(ylabel="unbalanced [kN]", xlim=(0.0, self.time[-1]), xlabel="time [s], strong motion shaded")


def interface_forces(
    record: RunRecord,
    feedback_scale: float,
    strong_motion: tuple[float, float],
    window: tuple[float, float] | None = None,
) -> InterfaceForces:
    """Return the forces of a run.

    Parameters
    ----------
    record : RunRecord
        The run.
    feedback_scale : float
        Share of the shear that is fed back.
    strong_motion : tuple of float
        Begin and end [s].
    window : tuple of float, optional
        Begin and end of what is shown closely [s].
    """
    estimated = feedback_scale * record.interface_force
    return InterfaceForces(
        record.time,
        record.required_force,
        estimated,
        record.corrected_force,
        feedback_scale * record.base_shear,
        record.required_force - estimated,
        feedback_scale,
        strong_motion,
        window,
    )


def figure(run: ReportedRun) -> InterfaceForces | str:
    """Return the figure of a run, or why there is none."""
    return part(
        run.no_forces,
        lambda: interface_forces(run.record, run.config.force_correction.feedback_scale, run.strong_motion, run.window),
    )


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    return [shown(figure(run), CAPTION)]
