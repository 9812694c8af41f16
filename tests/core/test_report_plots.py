"""Figures of a report: nothing is cut off or covered, text stays text, and the files are reproducible."""

import base64
import dataclasses
import io
import re
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
from fontTools.ttLib import TTFont
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.analysis.step_timing import StepTiming
from bmd_rths_core.analysis.thinning import thinned
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.plots.style import DOUBLE_COLUMN, style
from bmd_rths_core.plots.svg import svg
from bmd_rths_core.record import TimingStatistics
from bmd_rths_core.report.document import Document, Folded, Paragraph, Picture, Section, Table
from bmd_rths_core.report.figure_files import figures_of, write_figures
from bmd_rths_core.report.pdf import _pieces, _sheets, write_pdf
from bmd_rths_core.report.reported_run import ReportedRun
from bmd_rths_core.report.run_report import run_report
from bmd_rths_core.report.sections import (
    drifts,
    energy,
    forces,
    frequencies,
    hysteresis,
    responses,
    timing,
    tracking,
    transfer,
)
from bmd_rths_core.report.sections.comparison import comparisons

#: What a reader has to find on each figure.
STATED = {
    "responses": ["interface (computed): RMSE", "specimen floor 2 (measured)", "reference: building without partition"],
    "tracking": ["synchronisation", "achieved", "windows of 2 s", "delay [ms]"],
    "frequencies": ["magnitude [dB]", "phase [°]", "coherence"],
    "transfer": ["specimen floor 1 over ground", "interface over ground"],
    "forces": ["load cells, times 0.5", "required (Eq. 4)", "unbalanced [kN]", "around the largest shear"],
    "numerical_stories": ["numerical story 1", "drift [mm]"],
    "specimen_stories": ["specimen story 1", "specimen story 2"],
    "energy": ["brought by the interface", "limit 0.7", "stability indicator, at most 0."],
    "timing": ["Δt = 5 ms", "missed deadline", "closure of a step [ms]"],
    "comparison": ["run 1: plc_fc", "run 2: plc_fc"],
}


FIGURES = {
    "responses": responses.figure,
    "tracking": tracking.figure,
    "frequencies": frequencies.figure,
    "transfer": transfer.figure,
    "forces": forces.figure,
    "numerical_stories": hysteresis.numerical_figure,
    "specimen_stories": hysteresis.specimen_figure,
    "energy": energy.figure,
    "timing": timing.figure,
}


def svg_of(drawing):
    return svg(drawing.draw, drawing.height)


@pytest.fixture(scope="module")
def run():
    """Run a test with yielding stories and half of the shear."""
    config = Config().changed(
        ground_motion__duration=8.0,
        force_correction__feedback_scale=0.5,
        nonlinear__story_model="bilinear",
        nonlinear__integration="cr",
        nonlinear__yield_drifts=[1e-4],
    )
    record = RthsLoop(config, select_ground_motion(config.ground_motion, 0.005)).run()
    steps = np.arange(1600.0)
    begun = 0.005 * steps
    closed = begun + 1e-3 * np.random.default_rng(0).gamma(4.0, 0.4, size=1600)
    told = TimingStatistics(2, 2, (100, 101), 0, {"p50": 1.6, "p99": 4.0, "max": 4.9}, tuple(range(40)))
    hops = {"command": 1e3 * (closed - begun)}
    return ReportedRun(
        analysed(dataclasses.replace(record, timing=told)), StepTiming(steps, begun, closed, 0.005, (100, 101), hops)
    )


@pytest.fixture(scope="module")
def data(run):
    """Compute what every figure shows."""
    figures = {name: make(run) for name, make in FIGURES.items()}
    (figures["comparison"],) = comparisons([run, run])
    return figures


def texts(svg):
    """Return all text of an SVG file."""
    return "\n".join(text.text for text in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}text"))


@pytest.mark.parametrize("name", STATED)
def test_text_is_text_and_says_what_is_shown(data, name):
    shown = texts(svg_of(data[name]))
    for stated in STATED[name]:
        assert stated in shown
    assert "mathdefault" not in shown


@pytest.mark.parametrize("name", STATED)
def test_nothing_is_cut_off_or_covered(data, name):
    with style():
        figure = Figure(figsize=(DOUBLE_COLUMN / 25.4, data[name].height / 25.4))
        data[name].draw(figure)
        FigureCanvasAgg(figure).draw()
        drawn, page = figure.get_tightbbox(), figure.bbox_inches
        assert page.x0 <= drawn.x0 < drawn.x1 <= page.x1
        assert page.y0 <= drawn.y0 < drawn.y1 <= page.y1
        boxes = [legend.get_window_extent() for legend in figure.legends]
        boxes += [axes.get_tightbbox() for axes in figure.axes]
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


def drawn(data):
    """Return the axes of a figure."""
    with style():
        figure = Figure(figsize=(DOUBLE_COLUMN / 25.4, data.height / 25.4))
        data.draw(figure)
        return figure.axes


def test_peak_of_the_run_is_inside_the_transfer_functions_where_it_is_coherent(data):
    found = data["transfer"]
    higher = dataclasses.replace(found.run, response=found.run.response.copy(), coherence=found.run.coherence * 0)
    higher.response[5], higher.coherence[5] = 1e4, 1.0
    higher.response[9] = 1e8
    for axes in drawn(dataclasses.replace(found, run=higher)):
        assert 1e4 < axes.get_ylim()[1] < 1e6


def test_no_delay_is_cut_at_an_edge(data):
    delays = data["tracking"].delay_ms
    (axes,) = (axes for axes in drawn(data["tracking"]) if axes.get_ylabel() == "delay [ms]")
    room = 0.1 * np.ptp(delays)
    assert axes.get_ylim()[0] < delays.min() - room
    assert axes.get_ylim()[1] > delays.max() + room


def test_the_largest_shear_is_seen_closely(data):
    shears = data["forces"]
    begin, end = shears.largest
    assert end - begin == pytest.approx(2.0)
    at = shears.time[np.argmax(np.maximum(np.abs(shears.fed_back), np.abs(shears.required)))]
    assert begin <= at <= end
    unknown = np.full(len(shears.time), np.nan)
    assert dataclasses.replace(shears, fed_back=unknown, required=unknown).largest == (0.0, 2.0)


def test_heading_stands_on_the_sheet_of_its_figure_and_no_sheet_is_too_full(data):
    rows = tuple((f"a name that is much too long for the column it stands in {i}", str(i)) for i in range(9))
    sections = [
        Section(name, (Paragraph("word " * 50), Table(("name", "value"), rows), Picture(data[name], "caption")))
        for name in STATED
    ]
    sheets = list(_sheets(_pieces(Document("title", "verdict", True, ("a note",), tuple(sections)))))
    for name in STATED:
        (sheet,) = (sheet for sheet in sheets if any(piece.lines == (name,) for piece in sheet))
        assert any(piece.drawing is data[name] for piece in sheet)
    assert all(sum(piece.height for piece in sheet) <= 297.0 - 30.0 for sheet in sheets)


def document(data):
    rows = tuple((f"row {i}", str(i)) for i in range(40))
    blocks = (Paragraph("word " * 200), Table(("name", "value"), rows), *(Picture(data[n], n) for n in STATED))
    long = Folded("Configuration", "\n".join(f"line {i}" for i in range(200)))
    return Document("title", "verdict", True, ("a note",), (Section("Figures", blocks), Section("Text", (long,))))


@pytest.mark.slow
def test_same_data_give_the_same_bytes_and_a_pdf_has_as_many_sheets_as_are_filled(data, tmp_path):
    assert svg_of(data["energy"]) == svg_of(data["energy"])
    files = [tmp_path / name for name in ("one.pdf", "two.pdf")]
    for file in files:
        write_pdf(document(data), file)
    first, second = (file.read_bytes() for file in files)
    assert first == second
    assert first.startswith(b"%PDF")
    assert 8 <= int(re.search(rb"/Count (\d+)", first).group(1)) <= 12
    assert first.count(b"/MediaBox [ 0 0 595.2") == first.count(b"/Type /Page ")  # A4


def test_thinned_curves_keep_their_peaks():
    time = np.arange(20000) * 0.005
    values = np.random.default_rng(0).normal(size=20000)
    values[12345], values[777] = 50.0, -60.0
    short_time, short = thinned(time, values)
    assert len(short) < 2000
    assert (short.max(), short.min()) == (50.0, -60.0)
    assert short_time[short.argmax()] == time[12345]
    assert np.all(np.diff(short_time) >= 0.0)
    gap = np.where(np.arange(20000) == 5, np.nan, values)
    assert np.array_equal(thinned(time, gap)[1], gap, equal_nan=True)


def test_a_page_of_a_tall_building_ends_on_one_sheet(data):
    found = data["responses"]
    tall = dataclasses.replace(found, floors=found.floors * 10)
    assert tall.height <= 297.0 - 40.0


def curves(axes):
    """Return colour and dashes of every curve of some axes."""
    return [(line.get_color(), line.get_linestyle()) for line in axes.lines]


@pytest.mark.parametrize(("name", "at"), [("responses", 1), ("tracking", 0)])
def test_run_and_reference_are_told_apart_without_colour_where_single_cycles_are_seen(data, name, at):
    axes = drawn(data[name])[at]
    begin, end = axes.get_xlim()
    assert end - begin == pytest.approx(3.0)
    assert [dashes for _, dashes in curves(axes)] == ["-", "--"]
    assert "around the largest response" in texts(svg_of(data[name]))


@pytest.mark.slow
def test_close_up_holds_the_largest_response_or_what_was_chosen(run):
    close_up = run.closely
    largest = 0.005 * np.argmax(np.abs(run.analysis.reference[:, -1]))
    assert close_up.begin <= largest <= close_up.end
    chosen = dataclasses.replace(run, window=(2.0, 3.5))
    for name in ("responses", "tracking", "forces"):
        figure = FIGURES[name](chosen)
        assert "as chosen" in texts(svg_of(figure))
        assert (2.0, 3.5) in [axes.get_xlim() for axes in drawn(figure)]
    (together,) = comparisons([chosen, chosen])
    assert together.window == (2.0, 3.5)
    short = dataclasses.replace(run.analysis, reference=run.analysis.reference[:0])
    assert dataclasses.replace(run, analysis=short).closely.begin == 0.0


@pytest.mark.slow
def test_figures_of_a_report_are_files_with_truetype_inside(run, tmp_path):
    document = run_report(run)
    names = list(figures_of(document))
    assert names[:3] == ["quality", "response_of_the_floors", "tracking_of_the_table"]
    assert {"hysteresis", "hysteresis_2"} <= set(names)
    wanted = ("response_of_the_floors", "hysteresis_2")
    paths = write_figures(document, tmp_path, wanted)
    assert sorted(path.name for path in paths) == sorted(f"{n}.{ending}" for n in wanted for ending in ("pdf", "svg"))
    assert set(tmp_path.iterdir()) == set(paths)
    first = [path.read_bytes() for path in paths]
    assert [path.read_bytes() for path in write_figures(document, tmp_path, wanted)] == first
    for path, content in zip(paths, first, strict=True):
        if path.suffix == ".pdf":
            assert b"/Type3" not in content
            assert b"/FontFile2" in content
        else:
            assert "interface (computed)" in texts(content) or "specimen story 1" in texts(content)
            embedded = re.search(rb"font/ttf;base64,([^)]+)\)", content)[1]
            font = TTFont(io.BytesIO(base64.b64decode(embedded)))
            assert {ord(letter) for letter in texts(content) if letter != "\n"} <= set(font.getBestCmap())
    with pytest.raises(InputError, match="--only nothing: no figure of this report; some of quality, response"):
        write_figures(document, tmp_path, ["nothing"])


@pytest.mark.slow
def test_report_for_print_has_no_type_3(run, tmp_path):
    write_pdf(run_report(run), tmp_path / "report.pdf")
    assert b"/Type3" not in (tmp_path / "report.pdf").read_bytes()


def test_tables_of_displacements_and_drifts(run):
    floors, stories, _ = drifts.blocks(run)
    assert [row[0] for row in floors.rows] == ["interface"]
    assert [row[0] for row in stories.rows] == ["specimen story 2", "specimen story 1", "numerical story 1"]
    drift = run.motion.drifts[:, 0]
    _, own, _, difference, residual, shear = stories.rows[-1]
    assert own == f"{1e3 * np.abs(drift).max():.3f}"
    assert residual == f"{1e3 * drift[-1]:.3f}"
    assert shear == f"{1e-3 * np.abs(run.motion.story_forces).max():.2f}"
    # A story that yields drifts further than the table can tell from a building whose shear is whole.
    assert float(difference) == pytest.approx(100.0 * (float(own) / float(stories.rows[-1][2]) - 1.0), abs=0.5)
