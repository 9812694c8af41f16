"""How the table followed in time, and how its delay changed over the run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bmd_rths_core.analysis.metrics import tracking_delay
from bmd_rths_core.analysis.whole_samples import filled
from bmd_rths_core.plots.histories import between, plot_history
from bmd_rths_core.plots.layout import ABOVE, LABELS, Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLACK, BLUE, ORANGE, VERMILION
from bmd_rths_core.record import RunRecord
from bmd_rths_core.report.document import Block, shown
from bmd_rths_core.report.reported_run import CloseUp, ReportedRun, part

FloatArray = NDArray[np.float64]

TITLE = "Tracking of the table"

CAPTION = (
    "Acceleration of the table against the desired one, both at the end of a step. The delay is that of the largest "
    "cross-correlation; windows with less than a tenth of the strongest motion are left out."
)

#: How the desired acceleration is drawn: its dashes tell it from the achieved one without colour.
DESIRED: dict[str, Any] = {"color": BLACK, "linewidth": 0.9, "linestyle": (0, (4, 1.5))}

#: Length and distance of the windows in which the delay is estimated, and the longest one that is looked for [s].
WINDOW, HOP, LONGEST = 2.0, 0.5, 0.1

#: A window with less than this share of the largest root mean square says nothing about the delay.
QUIET = 0.1


@dataclass(frozen=True)
class TrackingHistory:
    """Desired and achieved acceleration of the table at the same times.

    Parameters
    ----------
    time : ndarray, shape (N,)
        [s].
    desired, achieved : ndarray, shape (N,)
        Of the interface, and measured on the table [m/s²].
    close_up : CloseUp
        What is shown closely.
    delay_time, delay_ms : ndarray, shape (w,)
        Middle of a window [s] and the delay in it [ms]; quiet windows are left out.
    overall_delay_ms : float
        Delay over the whole run [ms].
    """

    time: FloatArray
    desired: FloatArray
    achieved: FloatArray
    close_up: CloseUp
    delay_time: FloatArray
    delay_ms: FloatArray
    overall_delay_ms: float

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 125.0

    def draw(self, figure: Canvas) -> None:
        """Draw desired and achieved acceleration, their difference, synchronisation and delay over time."""
        grid = grid_in_mm(figure, 3, 2, between=(LABELS + 5.0, 18.0), width_ratios=(2.0, 1.0))
        history, error = grid[:2, 0].subgridspec(2, 1, hspace=0.12).subplots(sharex=True, squeeze=False)[:, 0]
        delay = figure.add_subplot(grid[2, 0])
        synchronisation = figure.add_subplot(grid[:2, 1])
        window = self.close_up.limits
        plot_history(history, *between(self.time, self.achieved, window), color=ORANGE, linewidth=1.4, label="achieved")
        plot_history(history, *between(self.time, self.desired, window), label="desired", **DESIRED)
        difference = self.achieved - self.desired
        plot_history(error, *between(self.time, difference, window), color=VERMILION, linewidth=0.7)
        history.legend(ncols=2, **ABOVE)
        history.set(ylabel="[m/s²]", xlim=window)
        error.set(ylabel="error [m/s²]", xlim=window, xlabel=f"time [s], {self.close_up.name}")
        synchronisation.plot(self.desired, self.achieved, color=BLUE, linewidth=0.3, rasterized=True)
        _diagonal(synchronisation)
        synchronisation.set(xlabel="desired [m/s²]", ylabel="achieved [m/s²]", title="synchronisation")
        delay.plot(self.delay_time, self.delay_ms, "o", color=BLUE, markersize=2.5, label="windows of 2 s")
        if np.isfinite(self.overall_delay_ms):
            delay.axhline(
                self.overall_delay_ms, color=BLACK, linewidth=0.8, label=f"all: {self.overall_delay_ms:.2f} ms"
            )
        delay.legend(ncols=2, **ABOVE)
        delay.margins(y=0.2)  # no point is cut at an edge
        delay.set(xlabel="time [s], whole run", ylabel="delay [ms]", xlim=(0.0, self.time[-1]))


def tracking_history(record: RunRecord, close_up: CloseUp) -> TrackingHistory:
    """Return how the table followed in time.

    Parameters
    ----------
    record : RunRecord
        The run.
    close_up : CloseUp
        What is shown closely.
    """
    desired, achieved = record.desired_acceleration[1:], record.table_acceleration[:-1]
    times, delays = delay_over_time(filled(desired), filled(achieved), record.time_step)
    overall = 1e3 * tracking_delay(desired, achieved, record.time_step)
    return TrackingHistory(record.time[1:], desired, achieved, close_up, times, delays, overall)


def delay_over_time(desired: FloatArray, achieved: FloatArray, time_step: float) -> tuple[FloatArray, FloatArray]:
    """Return the delay of the table in windows of `WINDOW` s, every `HOP` s.

    Parameters
    ----------
    desired, achieved : ndarray, shape (N,)
        At the same times, without gaps [m/s²].
    time_step : float
        Δt [s].

    Returns
    -------
    time, delay_ms : ndarray, shape (w,)
        Middle of each window [s] and the delay in it [ms]: that of the largest correlation coefficient between the
        window and what was achieved up to `LONGEST` s before and after it. Windows with less than `QUIET` of the
        largest root mean square are left out; a record shorter than a window has none.
    """
    length, hop, lags = round(WINDOW / time_step), round(HOP / time_step), round(LONGEST / time_step)
    surrounded = np.pad(achieved, lags)
    windows = [(begin, desired[begin : begin + length]) for begin in range(0, len(desired) - length + 1, hop)]
    loudest = max((float(np.mean(window**2)) for _, window in windows), default=0.0)
    times, delays = [], []
    for begin, window in windows:
        if float(np.mean(window**2)) > QUIET**2 * loudest:
            late = _samples_late(window, surrounded[begin : begin + length + 2 * lags])
            times.append((begin + 1 + 0.5 * length) * time_step)  # the first sample is that of step 1
            delays.append(1e3 * time_step * late)
    return np.array(times), np.array(delays)


def _samples_late(window: FloatArray, achieved: FloatArray) -> float:
    """Return by how many samples a window appears later in what lies around it as much before as behind."""
    shifted = sliding_window_view(achieved, len(window))
    sizes = np.sqrt(np.sum(shifted**2, axis=1))
    likeness = np.divide(shifted @ window, sizes, out=np.zeros(len(sizes)), where=sizes > 0.0)
    peak = int(np.argmax(likeness[1:-1])) + 1
    before, top, after = likeness[peak - 1 : peak + 2]
    curvature = before - 2.0 * top + after
    fraction = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
    return float(peak - len(shifted) // 2 + fraction)


def _diagonal(axes: Axes) -> None:
    lowest, highest = min(axes.get_xlim()[0], axes.get_ylim()[0]), max(axes.get_xlim()[1], axes.get_ylim()[1])
    axes.plot([lowest, highest], [lowest, highest], color=BLACK, linewidth=0.6)
    axes.set(xlim=(lowest, highest), ylim=(lowest, highest), aspect="equal")


def figure(run: ReportedRun) -> TrackingHistory | str:
    """Return the figure of a run, or why there is none."""
    return part(run.no_table, lambda: tracking_history(run.record, run.closely))


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    return [shown(figure(run), CAPTION)]
