"""The pages for people: every link leads somewhere, no page is too long, and all of them can be found."""

import os
import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
INDEX = DOCS / "index.md"
PICTURE = DOCS / "images" / "loop_and_response.svg"

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "bags/README.md", "benchmarks/README.md")),
    *sorted(DOCS.rglob("*.md")),
]

#: A page with more lines is two pages. The changelog grows with every version.
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
    "page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=lambda page: str(page.relative_to(ROOT))
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
    assert f"superstructure       │ {found.rmse_percent:.2f} %" in (ROOT / "README.md").read_text(encoding="utf-8")
