"""Linter, formatter and type checker of pyproject.toml have nothing to say, and a file has one subject."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("bmd_rths_core", "bmd_rths_msgs_py", "bmd_rths_nodes")
STRICT = PACKAGES[:2]
#: A file with more lines has more than one subject.
LONGEST_FILE = 400


def run(folder, *arguments, **environment):
    """Run a module of Python to its end."""
    return subprocess.run(
        [sys.executable, "-m", *arguments],
        cwd=folder,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
    )


@pytest.mark.parametrize(
    "arguments", [("ruff", "check", "--no-cache", "."), ("ruff", "format", "--check", "--no-cache", ".")], ids=" ".join
)
def test_clean(arguments):
    result = run(ROOT, *arguments)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("folder", [*PACKAGES, "benchmarks", "docs", "tests"])
def test_no_file_is_long(folder):
    lengths = {path: len(path.read_text().splitlines()) for path in (ROOT / folder).rglob("*.py")}
    assert lengths
    assert [path for path, length in lengths.items() if length > LONGEST_FILE] == []


@pytest.mark.long
@pytest.mark.slow
def test_the_type_checker_is_strict_and_finds_nothing_but_what_is_planted(tmp_path):
    """Both in one go, in a copy: a function without types is an error in two of the packages, and all else is clean."""
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for package in PACKAGES:
        shutil.copytree(ROOT / package / package, tmp_path / package / package)
        planted = tmp_path / package / package / "planted.py"
        planted.write_text('"""Planted."""\n\n\ndef planted(values):\n    return values\n')
    result = run(tmp_path, "mypy", "--cache-dir", os.devnull)
    *errors, last = result.stdout.splitlines()
    told = "planted.py:4: error: Function is missing a type annotation  [no-untyped-def]"
    assert sorted(errors) == [f"{package}/{package}/{told}" for package in STRICT], result.stdout + result.stderr
    assert last.startswith("Found 2 errors in 2 files")
