"""Draw how the actuator of the vRTHS benchmark problem follows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.plots.histories import plot_history
from bmd_rths_core.plots.layout import ABOVE, Canvas, grid_in_mm
from bmd_rths_core.plots.style import BLACK, ORANGE, VERMILION

FloatArray = NDArray[np.float64]


def draw_tracked_displacement(figure: Canvas, time: FloatArray, desired: FloatArray, measured: FloatArray) -> None:
    """Draw desired and measured displacement, and what they differ by.

    Parameters
    ----------
    figure : Figure or SubFigure
        Where.
    time, desired, measured : ndarray, shape (N,)
        [s], [m].
    """
    history, error = grid_in_mm(figure, 2, 1).subplots(sharex=True, squeeze=False)[:, 0]
    plot_history(history, time, 1e3 * measured, color=ORANGE, linewidth=1.4, label="measured")
    plot_history(history, time, 1e3 * desired, color=BLACK, linewidth=0.6, label="desired")
    plot_history(error, time, 1e3 * (measured - desired), color=VERMILION, linewidth=0.5)
    history.legend(ncols=2, **ABOVE)
    history.set(ylabel="[mm]")
    error.set(ylabel="error [mm]", xlabel="time [s]", xlim=(0.0, time[-1]))
