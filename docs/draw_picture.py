"""Draw the picture of the README from a simulated run.

python docs/draw_picture.py > docs/images/loop_and_response.svg
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Rectangle
from numpy.typing import NDArray

from bmd_rths_core import RthsLoop, load_config, select_ground_motion
from bmd_rths_core.analysis.metrics import reference_of, rmse_percent
from bmd_rths_core.paper_figures.time_history import strong_motion
from bmd_rths_core.plots.histories import between, plot_history
from bmd_rths_core.plots.layout import Canvas
from bmd_rths_core.plots.style import BLACK, BLUE, ORANGE
from bmd_rths_core.plots.svg import svg

CONFIG = Path(__file__).parents[1] / "config" / "simplified_bmd.yaml"

HEIGHT = 125.0  # mm

#: Width and height of a box of the diagram, whose axes are 180 units wide and 60 high [mm].
BOX = (38.0, 13.0)


class Response(NamedTuple):
    """Absolute acceleration of the superstructure [m/s²] at times [s], its error [%] and the strong motion [s]."""

    time: NDArray[np.float64]
    test: NDArray[np.float64]
    reference: NDArray[np.float64]
    rmse_percent: float
    strong_motion: tuple[float, float]


def response() -> Response:
    """Run the test of the README in process; row k of a sensor stands beside row k + 1 of the reference."""
    config = load_config(CONFIG)
    motion = select_ground_motion(config.ground_motion, config.run.time_step)
    record = RthsLoop(config, motion).run()
    test, reference = record.floor_accelerations[:-1, -1], reference_of(record, config)[1:, -1]
    window = strong_motion(reference, config.run.time_step)
    return Response(record.sensor_time[:-1], test, reference, rmse_percent(reference, test), window)


def picture(found: Response) -> bytes:
    """Return the picture as an SVG file.

    Parameters
    ----------
    found : Response
        The run it shows.
    """

    def draw(figure: Canvas) -> None:
        figure.patch.set_facecolor("white")  # readable on a dark page too
        draw_loop(figure.add_axes((0.0, 0.5, 1.0, 0.5)))
        draw_response(figure.add_axes((0.07, 0.09, 0.92, 0.34)), found)

    return svg(draw, HEIGHT)


def draw_loop(axes: Axes) -> None:
    """Draw one step of the loop: what is computed, and what stands on the table."""
    axes.set(xlim=(0.0, 180.0), ylim=(0.0, 60.0))
    axes.axis("off")
    axes.add_patch(Rectangle((2.0, 3.0), 176.0, 55.0, facecolor=BLUE, alpha=0.08))
    axes.add_patch(Rectangle((126.0, 29.0), 50.0, 27.0, facecolor="white"))
    axes.add_patch(Rectangle((126.0, 29.0), 50.0, 27.0, facecolor=ORANGE, alpha=0.15))
    axes.text(4.0, 53.0, "computer, every 5 ms", color="0.25")
    axes.text(128.0, 51.5, "laboratory, or its model", color="0.25")
    numerical = _box(axes, 25.0, 28.0, "lower part", "of the building", "numerical_substructure")
    shaper = _box(axes, 88.0, 41.0, "compensation", "of the table's delay", "command_shaper")
    driver = _box(axes, 150.0, 41.0, "shake table and", "upper part", "behind table_driver")
    estimator = _box(axes, 150.0, 15.0, "shear between", "the two parts", "shear_estimator")
    correction = _box(axes, 88.0, 15.0, "correction", "of the shear", "force_correction")
    _arrow(axes, (numerical[0] + 19.0, 31.0), (shaper[0] - 19.0, 41.0), "acceleration", (54.0, 39.5))
    _arrow(axes, (shaper[0] + 19.0, 41.0), (driver[0] - 19.0, 41.0), "command", (117.0, 43.0))
    _arrow(axes, (driver[0], 34.0), (estimator[0], 22.0), "sensors", (158.0, 25.5))
    _arrow(axes, (estimator[0] - 19.0, 15.0), (correction[0] + 19.0, 15.0), "force", (119.0, 17.0))
    _arrow(axes, (correction[0] - 19.0, 15.0), (numerical[0] + 19.0, 25.0), "shear, for the next step", (50.0, 14.0))
    _arrow(axes, (25.0, 47.0), (25.0, 35.0), "earthquake", (34.0, 43.0))


def _box(axes: Axes, x: float, y: float, *lines: str) -> tuple[float, float]:
    """Draw a box around a point: two lines that say what it is, and the name of its node."""
    width, height = BOX
    corner = (x - 0.5 * width, y - 0.5 * height)
    axes.add_patch(Rectangle(corner, width, height, facecolor="white", edgecolor=BLACK, linewidth=0.7))
    axes.text(x, y + 1.6, "\n".join(lines[:2]), ha="center", va="center", linespacing=1.1)
    axes.text(x, y - 4.6, lines[2], ha="center", va="center", fontsize=6.0, color="0.35", family="monospace")
    return x, y


def _arrow(
    axes: Axes, begin: tuple[float, float], end: tuple[float, float], text: str, place: tuple[float, float]
) -> None:
    arrow = FancyArrowPatch(begin, end, arrowstyle="-|>", mutation_scale=8.0, linewidth=0.8, color="0.2", shrinkA=0.0)
    axes.add_patch(arrow)
    axes.text(*place, text, ha="center", va="center", fontsize=7.0, color="0.2")


def draw_response(axes: Axes, found: Response) -> None:
    """Draw the strong motion of the superstructure in the test and in the building without partition."""
    curves = (
        (found.test, "measured on the simulated table", {"color": ORANGE, "linewidth": 1.6}),
        (found.reference, "whole building, computed", {"color": BLACK, "linewidth": 0.7}),
    )
    for values, label, look in curves:
        plot_history(axes, *between(found.time, values, found.strong_motion), label=label, **look)
    axes.set(xlim=found.strong_motion, xlabel="time [s], strong motion", ylabel="acceleration [m/s²]")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=2)
    axes.set_title(f"top floor, RMSE {found.rmse_percent:.1f} %", loc="left")


if __name__ == "__main__":
    sys.stdout.buffer.write(picture(response()))
