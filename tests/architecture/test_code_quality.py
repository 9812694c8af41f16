"""Linter, formatter and type checker, with the settings of pyproject.toml, have nothing to say."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    "arguments",
    [
        ("ruff", "check", "--no-cache", "."),
        ("ruff", "format", "--check", "--no-cache", "."),
        pytest.param(("mypy",), marks=pytest.mark.slow),
    ],
    ids=" ".join,
)
def test_clean(arguments, tmp_path):
    cache = ("--cache-dir", tmp_path) if arguments[0] == "mypy" else ()
    result = subprocess.run(
        [sys.executable, "-m", *arguments, *cache],
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("package", ["bmd_rths_core", "bmd_rths_msgs_py"])
def test_the_type_checker_is_strict(package, tmp_path):
    module = tmp_path / package / "planted.py"
    module.parent.mkdir()
    module.write_text("def planted(values):\n    return values\n")
    (tmp_path / package / "__init__.py").touch()
    options = ("--config-file", ROOT / "pyproject.toml", "--cache-dir", tmp_path / "cache")
    result = subprocess.run(
        [sys.executable, "-m", "mypy", *options, "-p", f"{package}.planted"],
        cwd=tmp_path,
        env={"MYPYPATH": str(tmp_path)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert "planted.py:1: error: Function is missing a type annotation" in result.stdout
