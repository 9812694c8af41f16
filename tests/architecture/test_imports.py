"""Who may import whom: the contracts of pyproject.toml hold, and they bite."""

import ast
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("bmd_rths_core", "bmd_rths_msgs_py", "bmd_rths_nodes")

#: Distributions whose module has another name.
MODULE_OF = {"PyYAML": "yaml", "fonttools": "fontTools"}


def lint_imports(root):
    """Check the contracts of a copy of the repository."""
    return subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as main; main()", "--no-cache"],
        cwd=root,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(str(root / package) for package in PACKAGES)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
    )


def copied(folder):
    """Copy the packages and the contracts."""
    shutil.copy(ROOT / "pyproject.toml", folder)
    for package in PACKAGES:
        shutil.copytree(ROOT / package / package, folder / package / package)
    return folder


def test_the_contracts_hold():
    result = lint_imports(ROOT)
    assert result.returncode == 0, result.stdout + result.stderr
    assert re.search(r"[1-9]\d* kept, 0 broken", result.stdout)


#: Imports that a contract forbids: the module that has it, the statement, and what is told of it.
PLANTED = [
    ("bmd_rths_core.compensators.phase_lead", "import rclpy", "bmd_rths_core is not allowed to import rclpy"),
    ("bmd_rths_core.table.models.simulated", "import time", "bmd_rths_core is not allowed to import time"),
    (
        "bmd_rths_core.loop.rths_loop",
        "from datetime import datetime",
        "bmd_rths_core is not allowed to import datetime",
    ),
    ("bmd_rths_core.table.controller", "import socket", "bmd_rths_core is not allowed to import socket"),
    ("bmd_rths_core.record", "from mcap.writer import Writer", "bmd_rths_core is not allowed to import mcap"),
    (
        "bmd_rths_core.analysis.metrics",
        "import matplotlib.pyplot",
        "bmd_rths_core is not allowed to import matplotlib",
    ),
    (
        "bmd_rths_core.safety.config",
        "import bmd_rths_core.compensators.phase_lead",
        "bmd_rths_core.safety.config -> bmd_rths_core",
    ),
    (
        "bmd_rths_core.structure.damping",
        "import bmd_rths_core.config",
        "bmd_rths_core.structure is not allowed to import bmd_rths_core.config",
    ),
    (
        "bmd_rths_core.loop.closed_loop",
        "from bmd_rths_core.analysis.metrics import run_metrics",
        "bmd_rths_core.loop is not allowed to import bmd_rths_core.analysis",
    ),
    (
        "bmd_rths_core.stages.force_correction",
        "import bmd_rths_core.compensators.schemes",
        "bmd_rths_core.stages is not allowed to import bmd_rths_core.compensators",
    ),
    (
        "bmd_rths_core.safety.ramp",
        "import bmd_rths_core.table.models.simulated",
        "bmd_rths_core.safety is not allowed to import bmd_rths_core.table",
    ),
    (
        "bmd_rths_core.report.document",
        "import matplotlib.pyplot",
        "bmd_rths_core is not allowed to import matplotlib",
    ),
    ("bmd_rths_msgs_py.cdr", "from rclpy.time import Time", "bmd_rths_msgs_py is not allowed to import rclpy"),
    ("bmd_rths_nodes.run.execute", "import rclpy", "bmd_rths_nodes is not allowed to import rclpy"),
    (
        "bmd_rths_nodes.cli.configuration",
        "from ament_index_python.packages import get_package_share_directory",
        "bmd_rths_nodes is not allowed to import ament_index_python",
    ),
    ("bmd_rths_nodes.ros.spin", "import numpy as np", "bmd_rths_nodes is not allowed to import numpy"),
]


@pytest.fixture(scope="module")
def told_of_planted(tmp_path_factory):
    """Plant all of them, each in a module of its own, and return what is told, with single blanks."""
    root = copied(tmp_path_factory.mktemp("planted"))
    assert len({module for module, _, _ in PLANTED}) == len(PLANTED)
    for module, statement, _ in PLANTED:
        path = root / module.partition(".")[0] / Path(*module.split(".")).with_suffix(".py")
        path.write_text(f"{path.read_text()}\n\ndef planted():\n    {statement}\n")
    result = lint_imports(root)
    assert result.returncode == 1, result.stdout + result.stderr
    return " ".join(result.stdout.split())


@pytest.mark.parametrize(("module", "statement", "broken"), PLANTED)
def test_a_planted_import_is_found(told_of_planted, module, statement, broken):
    line = len((ROOT / module.partition(".")[0] / Path(*module.split(".")).with_suffix(".py")).read_text().splitlines())
    imported = statement.split()[1]
    outside = imported.partition(".")[0] if not imported.startswith("bmd_rths") else imported
    assert broken in told_of_planted
    # The line says that it is this one, and nothing that another one leads to.
    assert f"{module} -> {outside} (l.{line + 4})" in told_of_planted


def test_a_module_without_a_layer_is_found(tmp_path):
    root = copied(tmp_path)
    (root / "bmd_rths_core" / "bmd_rths_core" / "planted.py").write_text('"""Belongs nowhere."""\n')
    result = lint_imports(root)
    assert result.returncode == 1, result.stdout + result.stderr
    assert "bmd_rths_core.planted" in result.stdout + result.stderr


def imported_modules(package):
    """Return the top-level modules outside this project and the standard library that a package imports."""
    nodes = [
        node for path in (ROOT / package / package).rglob("*.py") for node in ast.walk(ast.parse(path.read_text()))
    ]
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and not node.level}
    return {name.partition(".")[0] for name in names} - sys.stdlib_module_names - {package}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_imported_package_is_declared(package):
    setup = ast.parse((ROOT / package / "setup.py").read_text())
    keywords = {keyword.arg: keyword.value for node in ast.walk(setup) for keyword in getattr(node, "keywords", [])}
    pip = set(ast.literal_eval(keywords["install_requires"]))
    if "extras_require" in keywords:
        pip = pip.union(*ast.literal_eval(keywords["extras_require"]).values())
    ros = {depend.text for depend in ElementTree.parse(ROOT / package / "package.xml").iter("exec_depend")}
    assert imported_modules(package) <= {MODULE_OF.get(name, name) for name in pip} | ros
