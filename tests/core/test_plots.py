"""Drawn figures: the stated values stand on them, nothing is cut off or covered, and the files are reproducible."""

import struct
import subprocess
import sys
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from bmd_rths_core.analysis.metrics import run_metrics
from bmd_rths_core.config import load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.paper_figures import table_response
from bmd_rths_core.paper_figures.catalogue import figure_data
from bmd_rths_core.paper_figures.systems import EIGHT_STORY, FIGURES
from bmd_rths_core.plots import FORMATS
from bmd_rths_core.plots.drawing import draw, write_figure
from bmd_rths_core.plots.style import RESOLUTION, style, svg_of

CONFIGS = Path(__file__).parents[2] / "config"

#: What a reader has to find on each figure.
STATED = {
    6: ["constant delay of 26 ms (paper)", "interaction at 8.98 Hz (paper)", '"measured" is simulated', "model: Eq. 9"],
    7: ["35.43 rad/s", "system: 0.65 (paper: 0.65)", "paper: around 0.15", "paper: to 0.2", "unstable", "Eq. 9 + PLC"],
    8: ["35.43 rad/s", 'system: 0.65 (paper: 0.65, "very close")', "unstable", "one step (5 ms) of delay"],
    10: ["constant delay of 25 ms (paper)", "coefficients of the table are assumed", '"measured" is simulated'],
    11: [
        "94.09 rad/s",
        "paper: 0.2",
        "system: 0.161 (configured)",
        "unstable",
        "pure delay of 25 ms",
        "third-order servo",
        "without compensation",
        "Eq. 9, the table of the 8-story system",
    ],
    13: ["el_centro_1940_ns", "the paper's figure shows Parkfield", "PLC + FC", "m/s²", "the 5 s in which"],
}


@cache
def data_of(number):
    """Compute what a figure shows; the tables are measured for a quarter of the time, which is enough to draw."""
    system = "eight_story" if number in EIGHT_STORY.figures else "simplified"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_response, "_EXCITATION", replace(table_response._EXCITATION, duration=60.0))
        return figure_data(number, load_config(CONFIGS / f"{system}_bmd.yaml"))


@pytest.fixture(scope="module")
def files_of(tmp_path_factory):
    """Write a figure, once; return its paths."""
    folder = tmp_path_factory.mktemp("figures")
    return cache(lambda number: write_figure(data_of(number), folder, FORMATS))


def error_of_figure_13():
    """Return that of the superstructure with the scheme of the figure, from a run of the loop [%]."""
    config = load_config(CONFIGS / "simplified_bmd.yaml").changed(run__scheme="plc_fc")
    record = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    return run_metrics(record).rmse_percent["superstructure"]


def texts(path):
    """Return all text of an SVG file."""
    return "\n".join(text.text for text in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text"))


@pytest.mark.slow
@pytest.mark.parametrize("number", FIGURES)
def test_files_have_the_stated_values_and_their_size(files_of, number):
    png, svg = files_of(number)
    assert (png.name, svg.name) == (f"figure_{number}.png", f"figure_{number}.svg")
    shown = texts(svg)
    stated = [*STATED[number], *([f"RMSE (Eq. 12) {error_of_figure_13():.2f} %"] if number == 13 else [])]
    for text in stated:
        assert text in shown
    signature, width, height = struct.unpack(">16s2I", png.read_bytes()[:24])
    assert signature.startswith(b"\x89PNG")
    assert RESOLUTION >= 200
    assert width == pytest.approx(180.0 / 25.4 * RESOLUTION, abs=1.0)
    assert 0.4 * width < height < width


def test_parkfield_has_the_value_of_the_paper_and_a_stopped_test_says_why(tmp_path):
    (path,) = write_figure(replace(data_of(13), is_parkfield=True, stopped="limit of the table"), tmp_path, ["svg"])
    assert "paper: 48.84 %, Table 3" in texts(path)
    assert "the test was stopped: limit of the table" in texts(path)


@pytest.mark.parametrize("number", FIGURES)
def test_nothing_is_cut_off_or_covered_and_all_text_has_8_points(number):
    with style():
        figure = draw(data_of(number))
        FigureCanvasAgg(figure).draw()
        assert {text.get_fontsize() for text in figure.findobj(Text) if text.get_text()} == {8.0}
        drawn, page = figure.get_tightbbox(), figure.bbox_inches
        assert page.x0 <= drawn.x0 < drawn.x1 <= page.x1
        assert page.y0 <= drawn.y0 < drawn.y1 <= page.y1
        boxes = [legend.get_window_extent() for legend in figure.legends]
        boxes += [axes.get_tightbbox() for axes in figure.axes]
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


@pytest.mark.slow
@pytest.mark.parametrize("number", [7, 13])
def test_same_data_give_the_same_bytes_whatever_a_user_has_set(files_of, number, tmp_path):
    first = [path.read_bytes() for path in files_of(number)]
    with matplotlib.rc_context({"font.size": 20.0, "axes.grid": True, "svg.fonttype": "path"}):
        again = [path.read_bytes() for path in write_figure(data_of(number), tmp_path, FORMATS)]
        assert matplotlib.rcParams["font.size"] == 20.0
    assert first == again


def test_the_last_bit_of_a_place_does_not_change_the_file():
    def svg_of_axes(width):
        figure = Figure()
        figure.add_axes((0.1, 0.1, width, 0.5)).plot([0.0, 1.0])
        return svg_of(figure, 100)

    with style():
        assert svg_of_axes(0.7) == svg_of_axes(np.nextafter(0.7, 1.0)) != svg_of_axes(0.6)
        assert svg_of_axes(0.7).count(b'id="part_0"') == 1
        assert b"url(#part_" in svg_of_axes(0.7)


def test_curves_are_told_apart_without_colour():
    with style():
        for axes in draw(data_of(11)).axes:
            curves = [line for line in axes.lines if line.get_label().startswith("margin")]
            assert len({line.get_linestyle() + str(line._dash_pattern) for line in curves}) == len(curves) == 3


@pytest.mark.slow
def test_pyplot_and_its_global_figures_are_not_used():
    statement = "import sys, bmd_rths_core.plots.drawing; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", statement], stdin=subprocess.DEVNULL, timeout=120).returncode == 0
