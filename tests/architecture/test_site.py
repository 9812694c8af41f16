"""The documentation builds as a site, offline and without a warning, with every command and the front door on it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import bmd_rths_core
from bmd_rths_nodes.cli.main import COMMANDS

ROOT = Path(__file__).parents[2]
ELSEWHERE = ("http://", "https://", "//")


@pytest.mark.slow
def test_site_builds_without_a_warning_and_loads_nothing_from_elsewhere(tmp_path):
    site = tmp_path / "site"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-d", tmp_path / "doctrees"]
    # Nothing can be asked of the network: this proxy refuses every connection.
    offline = dict.fromkeys(("http_proxy", "https_proxy", "all_proxy"), "http://127.0.0.1:9")
    built = subprocess.run(
        [*map(str, command), str(ROOT / "docs"), str(site)],
        env={**os.environ, **offline},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (built.returncode, built.stderr) == (0, "")
    pages = {path.relative_to(site).as_posix(): path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    sources = {
        path.relative_to(ROOT / "docs").with_suffix(".html").as_posix() for path in (ROOT / "docs").rglob("*.md")
    }
    assert sources - set(pages) == {"index.html"}
    assert all(f"bmd-rths {name}" in pages["site/command_line.html"] for name in COMMANDS)
    assert pages["explanation/theory.html"].count("<math") > 10
    public = set(bmd_rths_core.__all__) - {"__version__"}
    assert {name for name in public if f"bmd_rths_core.{name}" not in pages["site/api.html"]} == set()
    for name, page in pages.items():
        loaded = [part.split('"')[1] for part in page.split("<script")[1:] if 'src="' in part.split(">")[0]]
        assert not [source for source in loaded if source.startswith(ELSEWHERE)], name
