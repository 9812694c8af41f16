"""The quality of a run: errors against the true building, capture, and delay and amplitude of the table over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.analysis.frequency_evaluation import frequency_evaluation_over_time
from bmd_rths_core.analysis.quality import KEYS
from bmd_rths_core.analysis.tracking_quality import SPECTRUM_TOLERANCE, tracking_indicator
from bmd_rths_core.analysis.whole_samples import filled
from bmd_rths_core.plots.layout import Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLACK, BLUE
from bmd_rths_core.report.document import Block, Paragraph, Table, shown
from bmd_rths_core.report.reported_run import ReportedRun, part
from bmd_rths_core.report.wording import number

FloatArray = NDArray[np.float64]

TITLE = "Quality"

ERRORS = (
    "True is against the building with the specimen that is on the table: the simulated one, or the identified one on "
    "a rig. Clean is the same for floors without noise, exact where they are simulated, else estimated. Capture is the "
    "share of a change of the specimen that the result follows: 1 is a hybrid test, 0 a simulation."
)
CAPTION = (
    "Delay and amplitude of the table by the frequency evaluation index in windows of 2 s, and the tracking indicator "
    "of Mercan, which grows where the table lags and falls where it leads. Quiet windows are left out."
)


@dataclass(frozen=True)
class TrackingOverTime:
    """Delay and amplitude in windows, and the tracking indicator.

    Parameters
    ----------
    window_time, delay_ms, amplitude : ndarray, shape (w,)
        Middle of each window [s], delay [ms] and amplitude [1].
    time, indicator : ndarray, shape (N,)
        [s] and [m²/s⁴].
    """

    window_time: FloatArray
    delay_ms: FloatArray
    amplitude: FloatArray
    time: FloatArray
    indicator: FloatArray

    @property
    def height(self) -> float:
        """Height [mm]."""
        return 100.0

    def draw(self, figure: Canvas) -> None:
        """Draw the three below each other."""
        delay, amplitude, indicator = grid_in_mm(figure, 3, between=(6.0, 0.0)).subplots(sharex=True, squeeze=False)[
            :, 0
        ]
        for axes, values, right in ((delay, self.delay_ms, 0.0), (amplitude, self.amplitude, 1.0)):
            axes.axhline(right, color=BLACK, linewidth=0.6)
            axes.plot(self.window_time, values, "o", color=BLUE, markersize=2.5)
            axes.margins(y=0.2)
        indicator.plot(self.time, self.indicator, color=BLUE, linewidth=0.8)
        delay.set(ylabel="delay [ms]")
        amplitude.set(ylabel="amplitude [1]")
        indicator.set(ylabel="indicator [m²/s⁴]", xlabel="time [s]", xlim=(0.0, self.time[-1]))


def figure(run: ReportedRun) -> TrackingOverTime | str:
    """Return the figure of a run, or why there is none."""
    return part(run.no_table, lambda: _over_time(run))


def blocks(run: ReportedRun) -> list[Block]:
    """Return the section of a run."""
    return [quality_table(run), Paragraph(ERRORS), tracking_table(run), shown(figure(run), CAPTION)]


def quality_table(run: ReportedRun) -> Table:
    """Return errors and capture at interface and floors."""
    quality, stable = run.analysis.quality, run.record.stable
    capture = quality.capture._asdict()
    errors = {
        "true error [%]": quality.rmse_true_percent,
        "clean error [%]": quality.rmse_clean_percent,
        "noise of the sensor [%]": quality.noise_floor_percent,
        "excess over the noise [%]": quality.excess_percent,
    }
    rows = [(name, *(number(values[key] if stable else None, 2) for key in KEYS)) for name, values in errors.items()]
    rows.append(("capture [1]", *(number(capture.get(key) if stable else None, 2) for key in KEYS)))
    return Table(("", *(key.replace("_", " ") for key in KEYS)), tuple(rows))


def tracking_table(run: ReportedRun) -> Table:
    """Return how the table followed."""
    tracking = run.analysis.quality.tracking
    lowest, highest = SPECTRUM_TOLERANCE
    rows = (
        ("tracking error, without noise [%]", number(tracking.error_percent, 2)),
        ("delay [ms]", number(tracking.delay_ms, 2)),
        ("amplitude [1]", number(tracking.amplitude, 3)),
        ("at the frequency [Hz]", number(tracking.frequency_hz, 2)),
        ("tracking indicator, sine of the phase [1]", number(tracking.indicator, 3)),
        (
            f"response spectrum beyond {lowest:g} to {highest:g} [% of frequencies]",
            number(tracking.spectrum_out_percent),
        ),
        ("peak of the table over the desired one [1]", number(tracking.peak_ratio, 3)),
    )
    return Table(("table", "value"), rows)


def _over_time(run: ReportedRun) -> TrackingOverTime:
    desired = filled(run.record.desired_acceleration[1:])
    achieved = filled(run.analysis.quality.clean.table[:-1])
    times, found = frequency_evaluation_over_time(desired, achieved, run.record.time_step)
    return TrackingOverTime(
        run.record.time_step + times,
        np.array([evaluation.delay_ms for evaluation in found]),
        np.array([evaluation.amplitude for evaluation in found]),
        run.record.time[1:],
        tracking_indicator(desired, achieved),
    )
