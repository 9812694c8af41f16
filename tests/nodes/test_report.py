"""`bmd-rths analyze --report`: one page that needs nothing else, and one clear line where there can be none."""

import base64
import dataclasses
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.record import TimingStatistics
from bmd_rths_core.report.wording import ending, problems, results
from bmd_rths_msgs_py.record_bag import write_record

#: Tags that have no end.
VOID = {"meta", "link", "img"}


class Page(HTMLParser):
    """Check the nesting of a page and collect its text, tags and addresses."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.addresses, self.text = [], [], [], ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("href", "src")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


@pytest.fixture(scope="module")
def record():
    """Run six seconds of a test with stories that yield."""
    config = Config().changed(
        ground_motion__duration=6.0,
        nonlinear__story_model="bilinear",
        nonlinear__integration="cr",
        nonlinear__yield_drifts=[1e-4],
    )
    return RthsLoop(config, select_ground_motion(config.ground_motion, 0.005)).run()


def changed(record, change, **fields):
    return dataclasses.replace(record, **{name: change(s) for name, s in record.signals().items()}, **fields)


@pytest.mark.slow
def test_page_is_whole_needs_no_network_and_says_the_verdict_first(run_main, record, tmp_path):
    bag = write_record(record, tmp_path / "bag")
    status, output, errors = run_main("analyze", bag, "--report", "report.html", "--json")
    assert (status, errors) == (0, "report: report.html\n")
    result = json.loads(output)
    text = (tmp_path / "report.html").read_text()
    page = Page(text)
    assert all(address.startswith("data:") for address in page.addresses)
    assert not {"script", "iframe", "object"} & set(page.tags)
    assert "url(" not in text
    assert "@import" not in text
    figures = [base64.b64decode(a.partition(",")[2]).decode() for a in page.addresses if "svg" in a]
    assert len(figures) == page.tags.count("figure") == 9
    for svg in figures:
        assert all(reference.startswith(("#", "data:")) for reference in re.findall(r'href="([^"]*)"', svg))
    errors = f"superstructure {result['rmse_percent']['superstructure']:.1f} %; the table is"
    assert "criterionvalue" in page.text
    order = (
        "Not good. Finished",
        errors,
        "virtual laboratory",
        "RMSE (Eq. 12)",
        "clean error",
        "Limits",
        "Response of the floors",
    )
    places = [page.text.index(words) for words in order]
    assert places == sorted(places)
    for words in (
        "J2 tracking error",
        "ductility",
        "without a clock",
        record.motion["sha256"],
        "yield_drifts",
        "numpy",
    ):
        assert words in page.text
    assert f"{result['rmse_percent']['superstructure']:.2f}" in page.text
    assert f"{result['benchmark_criteria']['J3']:.2f}" in page.text
    assert f"{result['ductility'][0]:.2f}" in page.text


@pytest.mark.parametrize("steps", [0, 1, 3, 10])
def test_test_that_was_ended_at_once_has_a_report_that_says_so(run_main, record, tmp_path, steps):
    reason = "safety.force_limit passed <script>alert(1)</script>"
    short = changed(record, lambda signal: signal[:steps], outcome="limit", reason=reason)
    bag = write_record(short, tmp_path / "bag")
    status, output, _ = run_main("analyze", bag, "--report", "report.html")
    assert status == 0
    assert "not the whole ground motion" in " ".join(output.split())
    text = (tmp_path / "report.html").read_text()
    assert "<script" not in text
    page = Page(text)
    for words in (f"Ended by a limit: {reason}", f"steps: {steps}", "Cannot be shown", "The errors are left out"):
        assert words in page.text
    for words in ("RMSE against", "diverged", "may have led"):
        assert words not in page.text
    assert re.search(r"J7 peak error, interface \[%\]\s*–", page.text)
    delay = re.search(r"J1 tracking delay \[ms\]\s*([\d.–]+)", page.text).group(1)
    assert (delay == "–") == (" ms late" not in page.text)
    _, output, _ = run_main("analyze", bag, "--json")
    criteria = json.loads(output)["benchmark_criteria"]
    told = {symbol: value for symbol, value in criteria.items() if value is not None}
    assert told == ({} if delay == "–" else {"J1": pytest.approx(float(delay), abs=0.005)})
    assert page.tags.count("figure") == (6 if steps >= 3 else 0)


@pytest.mark.slow
def test_gaps_zeros_and_markup_in_names_are_no_obstacle(run_main, record, tmp_path):
    rng = np.random.default_rng(0)
    motion = {**record.motion, "name": "<b>&"}
    gaps = changed(record, lambda s: np.where(rng.random(s.shape) < 0.05, np.nan, s), motion=motion)
    zeros = changed(record, np.zeros_like)
    for name, hostile, words in (
        ("gaps", gaps, "values were not recorded"),
        ("zeros", zeros, "the excitation is zero"),
    ):
        bag = write_record(hostile, tmp_path / name)
        assert run_main("analyze", bag, "--report", f"{name}.html")[0] == 0
        assert words in Page((tmp_path / f"{name}.html").read_text()).text
    assert "<h1>&lt;b&gt;&amp;, plc_fc</h1>" in (tmp_path / "gaps.html").read_text()


@pytest.mark.slow
def test_several_bags_are_compared_on_one_page(run_main, record, tmp_path):
    other = RthsLoop(
        Config().changed(
            **{f"nonlinear__{k}": v for k, v in record.configuration["nonlinear"].items()}, run__scheme="uc"
        ),
        select_ground_motion(Config().changed(ground_motion__duration=6.0).ground_motion, 0.005),
    ).run()
    empty = changed(record, lambda signal: signal[:0], outcome="limit", reason="safety.force_limit")
    named = (("one", record), ("two", other), ("three", empty))
    bags = [write_record(r, tmp_path / name) for name, r in named]
    status, output, _ = run_main("analyze", *bags, "--report", "all.html", "--json")
    assert status == 0
    page = Page((tmp_path / "all.html").read_text())
    assert page.tags.count("figure") == 1
    for run in json.loads(output)["runs"]:
        for value in (*run["rmse_percent"].values(), *run["benchmark_criteria"].values()):
            assert value is None or f"{value:.2f}" in page.text
    assert "2 of 3 runs have finished" in page.text
    for words in ("1: plc_fc, one", "2: uc, two", "Runs 1, 2, 3: The table is a virtual", "J7 peak error, interface"):
        assert words in page.text
    assert "J5 peak error" not in page.text
    assert page.text.index("1: plc_fc, one") < page.text.index("Run 3: The errors are left out")


@pytest.mark.slow
def test_what_is_said_of_deadlines_and_of_the_operator(record):
    timing = TimingStatistics(3, 2, (5, 6, 9), 0, {"p50": 1.0, "p99": 2.0, "max": 3.0})
    late = analysed(dataclasses.replace(record, outcome="limit", reason="safety.increment_limit", timing=timing))
    assert "3 deadlines missed" in results(late)
    words = "3 of 1201 deadlines were missed, at most 2 in a row; the last shear was held."
    assert f"{words} This may have led to the limit." in problems(late, 0.0)
    in_time = dataclasses.replace(timing, missed_deadlines=0, max_consecutive_misses=0, missed_steps=())
    for lockstep in (False, True):
        configuration = {**record.configuration, "run": {**record.configuration["run"], "lockstep": lockstep}}
        run = analysed(dataclasses.replace(record, configuration=configuration, timing=in_time))
        assert ("deadlines" in results(run)) != lockstep
    stopped = dataclasses.replace(record, outcome="stopped", reason="table_driver: stopped by the operator")
    assert ending(stopped) == "Stopped by the operator."
    other = dataclasses.replace(stopped, reason="the launch was interrupted")
    assert ending(other) == "Stopped by the operator: the launch was interrupted"


@pytest.mark.slow
def test_report_for_print_is_a_pdf(run_main, record, tmp_path):
    bag = write_record(record, tmp_path / "bag")
    assert run_main("analyze", bag, "--report", "report.pdf")[0] == 0
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("file", "named"),
    [("report.docx", "unknown ending '.docx'; one of .html, .pdf"), ("none/report.html", "a folder that exists")],
)
def test_file_that_cannot_be_written_is_told_before_any_work(run_main, tmp_path, file, named):
    status, output, errors = run_main("analyze", "no_bag_at_all", "--report", file)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert f"--report {file}" in errors
    assert named in errors


def test_bag_of_another_version_is_refused_by_name(run_main, record, tmp_path):
    configuration = {**record.configuration, "unknown_section": {}}
    bag = write_record(dataclasses.replace(record, configuration=configuration), tmp_path / "bag")
    status, output, errors = run_main("analyze", bag)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert f"{bag}: configuration: unknown_section" in errors


@pytest.mark.slow
def test_figures_for_a_paper(run_main, record, tmp_path):
    bag = write_record(record, tmp_path / "bag")
    arguments = ("--figures", "figures", "--only", "response_of_the_floors", "--window", "2,4")
    status, output, errors = run_main("analyze", bag, *arguments, "--json")
    assert status == 0
    assert json.loads(output)["outcome"] == "finished"
    files = [f"figures/response_of_the_floors.{ending}" for ending in ("pdf", "svg")]
    assert errors.splitlines() == [f"figure: {file}" for file in files]
    assert "time [s], as chosen" in (tmp_path / files[1]).read_text()


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("--window", "1,2"), "--window: nothing is drawn; --report or --figures is required"),
        (("--only", "forces", "--report", "r.html"), "--only: --figures is required"),
        (("--window", "2", "--report", "r.html"), "--window 2: BEGIN,END in seconds is required"),
        (("--window", "2,1", "--report", "r.html"), "--window 2,1: 0 <= BEGIN < END is required"),
        (
            ("--window", "1,99", "--report", "r.html"),
            "--window: 99 s is behind the end of bag; at most 6 s is required",
        ),
        (("--figures", "f", "--only", "face"), "--only face: no figure of this report; some of quality, response"),
    ],
)
def test_wrong_figure_or_window_is_one_line(run_main, record, tmp_path, arguments, problem):
    bag = write_record(record, tmp_path / "bag")
    status, output, errors = run_main("analyze", bag, *arguments)
    assert (status, output) == (2, "")
    assert errors.startswith(f"error: {problem}")
    assert errors.count("\n") == 1
