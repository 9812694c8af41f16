"""The pages for people: every link leads somewhere, no page is too long, and all of them can be found."""

import os
import re
import runpy
import subprocess
import sys
import textwrap
import types
from pathlib import Path

import pytest

from bmd_rths_core import RthsLoop, load_config, select_ground_motion
from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.plots.svg import svg
from bmd_rths_core.report.reported_run import ReportedRun

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
INDEX = DOCS / "index.md"
PICTURE = DOCS / "images" / "loop_and_response.svg"

PAGES = [
    *(
        ROOT / name
        for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "bags/README.md", "benchmarks/README.md")
    ),
    *sorted(DOCS.rglob("*.md")),
]

#: A page with more lines is two pages. The changelog grows with every version, the generated page with every parameter.
LONGEST_PAGE = 300

#: Words of the README: it says what this is, shows it, and sends people on.
LONGEST_README = 1000


def links(text):
    """Return the targets of the links and pictures of a page, without those in blocks of code."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", prose))


def heading_anchors(text):
    """Return the anchors that GitHub makes of the headings."""
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken_links(page):
    broken = []
    for target in links(page.read_text(encoding="utf-8")):
        path, _, anchor = target.partition("#")
        if "://" in path:
            continue
        found = page if not path else Path(os.path.normpath(page.parent / path))
        if not found.exists() or (anchor and anchor not in heading_anchors(found.read_text(encoding="utf-8"))):
            broken.append(target)
    return broken


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    assert broken_links(page) == []


def test_a_broken_link_is_found(tmp_path):
    page = tmp_path / "page.md"
    (tmp_path / "other.md").write_text("# A heading, with a comma\n", encoding="utf-8")
    page.write_text(
        "[a](other.md) [b](other.md#a-heading-with-a-comma) [c](gone.md) [d](other.md#gone) `[e](code.md)`\n"
        "```\n[f](block.md)\n```\n![g](gone.svg) [h](https://example.org/page)\n",
        encoding="utf-8",
    )
    assert broken_links(page) == ["gone.md", "other.md#gone", "gone.svg"]


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if page.name not in ("CHANGELOG.md", "parameters.md")],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_no_page_is_too_long(page):
    assert len(page.read_text(encoding="utf-8").splitlines()) <= LONGEST_PAGE


def test_index_leads_to_every_page():
    listed = {os.path.normpath(DOCS / target.partition("#")[0]) for target in links(INDEX.read_text(encoding="utf-8"))}
    pages = {str(page) for page in DOCS.rglob("*.md") if page != INDEX}
    assert sorted(pages - listed) == []


def test_readme_is_short_and_shows_what_comes_out():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.split()) < LONGEST_README
    assert len(text.splitlines()) <= 120
    assert "![" in text
    assert "docs/images/loop_and_response.svg" in text
    assert "docs/index.md" in links(text)


def test_readme_has_the_test_command_that_the_pipeline_runs():
    """`.ci/run` takes the block of code after the marker."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"<!-- test command -->\n```sh\n(.*?)\n```\n", text, flags=re.DOTALL)
    assert "requirements-test.txt" in command
    assert "pytest" in command


def test_picture_shows_the_run_that_the_readme_tells_of():
    drawn = runpy.run_path(str(DOCS / "draw_picture.py"))
    found = drawn["response"]()
    error = f"RMSE {found.rmse_percent:.1f} %"
    assert error in drawn["picture"](found).decode()
    kept = PICTURE.read_text(encoding="utf-8")
    assert error in kept, "run: python docs/draw_picture.py > docs/images/loop_and_response.svg"
    told = re.search(r"RMSE superstructure +│ ([0-9.]+) %", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert told[1] == f"{found.rmse_percent:.2f}"


def code_of(page, language="python"):
    """Return the first block of code of a page."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return textwrap.dedent(re.search(rf"^ *```{language}\n(.*?)^ *```", text, flags=re.MULTILINE | re.DOTALL)[1])


def test_compensator_of_the_page_is_found_by_its_name(tmp_path):
    """As its page says: a package of its own, an entry point, and a section of the configuration."""
    package, metadata = tmp_path / "my_package", tmp_path / "my_package-1.0.dist-info"
    package.mkdir()
    metadata.mkdir()
    (package / "__init__.py").touch()
    (package / "derivative.py").write_text(code_of("how-to/add_a_compensator.md"), encoding="utf-8")
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: my_package\nVersion: 1.0\n", encoding="utf-8")
    page = (DOCS / "how-to" / "add_a_compensator.md").read_text(encoding="utf-8")
    group, entry = re.search(r'entry_points = {"(.*?)": \["(.*?)"\]}', page).groups()
    (metadata / "entry_points.txt").write_text(f"[{group}]\n{entry}\n", encoding="utf-8")
    given = ("--scheme", "derivative", "--set", "derivative_lead.lead_time=0.01", "--set", "ground_motion.duration=1")
    finished = subprocess.run(
        [sys.executable, "-m", "bmd_rths_nodes.cli.main", "simulate", ROOT / "config/simplified_bmd.yaml", *given],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    assert "el_centro_1940_ns, derivative: finished" in finished.stdout


def test_section_of_the_page_is_drawn():
    section = {"__name__": "my_section"}
    sys.modules["my_section"] = types.ModuleType("my_section")  # dataclasses look their module up
    try:
        exec(code_of("how-to/add_a_report_section.md"), section)
    finally:
        del sys.modules["my_section"]
    config = load_config(ROOT / "config" / "simplified_bmd.yaml").changed(ground_motion__duration=1.0)
    record = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    (block,) = section["blocks"](ReportedRun(analysed(record), "a run in process has no timing"))
    assert block.caption == section["CAPTION"]
    assert b"</svg>" in svg(block.drawing.draw, block.drawing.height)
