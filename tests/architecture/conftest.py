"""What tests of installations share: the wheels of the packages, built once."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import made_once

ROOT = Path(__file__).parents[2]
FOLDERS = ("bmd_rths_core", "bmd_rths_msgs_py", "bmd_rths_nodes", "packaging/bmd-rths", "examples/my_rths_nodes")


@pytest.fixture(scope="session")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the wheels of all packages."""
    return made_once(tmp_path_factory, "wheels", _build)


def _build(folder: Path) -> None:
    """Build in a copy, because building leaves files beside the sources."""
    sources = folder / "sources"
    for name in (*FOLDERS, "config"):  # a package has links to the configurations
        ignored = shutil.ignore_patterns("build", "install", "log", "*.egg-info", "__pycache__")
        shutil.copytree(ROOT / name, sources / name, symlinks=True, ignore=ignored)
    offline = ("--no-index", "--no-build-isolation", "--no-deps", "--no-cache-dir")
    done = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", *offline, "--wheel-dir", folder, *(sources / f for f in FOLDERS)],
        cwd=sources,
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
