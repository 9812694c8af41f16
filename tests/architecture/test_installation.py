"""The packages install with pip and with colcon, and `ros2 run` and `ros2 launch` find everything in either case."""

import ast
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from tests.domains import free_domain

ROOT = Path(__file__).parents[2]
PACKAGES = ("bmd_rths_core", "bmd_rths_msgs_py", "bmd_rths_nodes")
EXECUTABLES = (
    "numerical_substructure",
    "command_shaper",
    "table_driver",
    "shear_estimator",
    "force_correction",
    "recorder",
)

#: The package of the how-to page "Write a node of your own".
EXAMPLE = "my_rths_nodes"

#: Keys of rosdep that are not `python3-` and the name on PyPI.
KEYS = {
    "filterpy": "python3-filterpy-pip",
    "mcap": "mcap-ros2-support",
    "PyYAML": "python3-yaml",
    "rosbags": "python3-rosbags-pip",
}

#: Set by the start-up code of the ROS wheels; a child in another environment must go through it again.
WHEELS_STARTED = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


@pytest.fixture
def copy(tmp_path):
    """Copy what is installed, because building leaves files beside the sources."""
    for folder in (*PACKAGES, "config", "ros2_ws", "examples"):
        ignored = shutil.ignore_patterns("build", "install", "log", "*.egg-info", "__pycache__")
        shutil.copytree(ROOT / folder, tmp_path / "copy" / folder, symlinks=True, ignore=ignored)
    (tmp_path / "copy" / "ros2_ws" / "src" / EXAMPLE).symlink_to(f"../../examples/{EXAMPLE}")
    return tmp_path / "copy"


@pytest.fixture
def environment(tmp_path):
    """Return an environment in which this checkout cannot be imported."""
    ours = ("PYTHONPATH", "PYTHONHOME", WHEELS_STARTED)
    paths = [Path(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    elsewhere = [str(path) for path in paths if not any((path / package).is_dir() for package in PACKAGES)]
    with free_domain() as domain:
        yield {
            **{name: value for name, value in os.environ.items() if name not in ours},
            "PYTHONPATH": os.pathsep.join(elsewhere),
            "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOG_DIR": str(tmp_path / "log"),
            "COLCON_HOME": str(tmp_path / "colcon"),
        }


def run(arguments, folder, environment):
    """Run a command to its end and return what came of it."""
    return subprocess.run(
        [str(argument) for argument in arguments],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
    )


def succeed(arguments, folder, environment):
    """Run a command that has to succeed and return its output."""
    result = run(arguments, folder, environment)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def assert_installed(prefixes, folder, environment, monkeypatch):
    """Everything is where ROS looks for it, and every executable starts from there."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", environment["AMENT_PREFIX_PATH"])
    for package in PACKAGES:
        assert Path(get_package_prefix(package)) == prefixes[package]
        assert (Path(get_package_share_directory(package)) / "package.xml").is_file()
    share = Path(get_package_share_directory("bmd_rths_nodes"))
    assert (share / "launch" / "rths.launch.py").is_file()
    assert {path.name for path in (share / "config").iterdir()} == {path.name for path in (ROOT / "config").iterdir()}
    folder_of = {package: prefixes[package] / "lib" / package for package in ("bmd_rths_nodes", EXAMPLE)}
    executables = [folder_of["bmd_rths_nodes"] / name for name in EXECUTABLES] + [folder_of[EXAMPLE] / "table_driver"]
    assert [path for path in executables if not os.access(path, os.X_OK)] == []
    assert get_package_prefix(EXAMPLE) == str(prefixes[EXAMPLE])
    # A parameter that does not exist makes the node say so and end; to get there it has to import everything.
    with ThreadPoolExecutor() as pool:
        asked = [(executable, "--ros-args", "-p", "nonsense.key:=1") for executable in executables]
        refusals = list(pool.map(lambda arguments: run(arguments, folder, environment), asked))
    for refused in refusals:
        assert (refused.returncode, refused.stdout) == (2, ""), refused.stderr
        (line,) = refused.stderr.splitlines()
        assert line.startswith("error: nonsense: unknown section")


def where_imported(python, folder, environment):
    """Return the folders the packages are imported from."""
    files = f"import {', '.join(PACKAGES)}; print(*({', '.join(f'{package}.__file__' for package in PACKAGES)}))"
    return [Path(file) for file in succeed([python, "-c", files], folder, environment).split()]


def required(package):
    """Return what setup.py of a package requires of everybody."""
    tree = ast.parse((ROOT / package / "setup.py").read_text())
    return next(
        ast.literal_eval(node.value) for node in ast.walk(tree) if getattr(node, "arg", None) == "install_requires"
    )


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_has_a_key_for_each_requirement(package):
    manifest = ElementTree.parse(ROOT / package / "package.xml")
    keys = {node.text for node in manifest.iter("exec_depend")}
    needed = {name if name in PACKAGES else KEYS.get(name, f"python3-{name}") for name in required(package)}
    assert needed - keys == set()


@pytest.mark.parametrize("python", ["3.10.12", "3.11.2", "3.12.3", "3.13.0"])  # as distributions have them
def test_each_version_that_is_required_runs_on_the_python_that_it_is_required_for(python):
    lines = (line.partition("#")[0].strip() for line in (ROOT / "constraints.txt").read_text().splitlines())
    environment = {"python_version": python.rpartition(".")[0], "python_full_version": python}
    pins = [Requirement(line) for line in lines if line]
    pinned = [pin for pin in pins if pin.marker is None or pin.marker.evaluate(environment)]
    told = {str(pin): requires for pin in pinned if (requires := requires_python(pin))}
    assert len(told) > 50
    assert not {pin: requires for pin, requires in told.items() if not SpecifierSet(requires).contains(python)}


def requires_python(pin):
    """Return what an installed version says of the Python that it needs; None where another version is installed."""
    try:
        installed = metadata.distribution(pin.name)
    except metadata.PackageNotFoundError:
        return None
    return installed.metadata["Requires-Python"] if pin.specifier.contains(installed.version) else None


def test_page_beside_apt_installs_what_apt_does_not_have():
    """ROS from apt brings numpy and PyYAML, filterpy brings scipy."""
    page = (ROOT / "docs" / "how-to" / "install_with_ros_from_apt.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^pip install (.*)$", page, flags=re.MULTILINE)
    needed = {name for package in PACKAGES for name in required(package)} - set(PACKAGES)
    assert needed - {"numpy", "PyYAML", "scipy"} - set(line.split()) == set()


@pytest.mark.slow
def test_pip(wheels, tmp_path, environment, monkeypatch):
    prefix = tmp_path / "venv"
    succeed([sys.executable, "-m", "venv", "--without-pip", prefix], tmp_path, environment)
    (site_packages,) = prefix.glob("lib/python*/site-packages")
    # What the packages need comes from the environment of the tests, behind what is installed here.
    shared = [path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")]
    (site_packages / "shared.pth").write_text("\n".join(shared))
    python = prefix / "bin" / "python"
    offline = ("--no-index", "--no-deps", "--ignore-installed", "--no-cache-dir")
    found = ("--find-links", wheels, "bmd-rths", *PACKAGES, EXAMPLE)
    succeed([python, "-m", "pip", "install", *offline, *found], tmp_path, environment)
    # As `pipx install bmd-rths[ros]` does: every requirement of the extras has a name that exists, and is there.
    extras = ("--no-index", "--dry-run", "bmd-rths[ros,foxglove,parquet,mat73,cluster,docs]")
    told = succeed([python, "-m", "pip", "install", *extras], tmp_path, environment)
    assert "Would install" not in told
    assert "does not provide the extra" not in told
    assert "simulate" in succeed([prefix / "bin" / "bmd-rths", "--help"], tmp_path, environment)
    assert all(site_packages in file.parents for file in where_imported(python, tmp_path, environment))
    environment["AMENT_PREFIX_PATH"] = os.pathsep.join([str(prefix), os.environ.get("AMENT_PREFIX_PATH", "")])
    assert_installed(dict.fromkeys((*PACKAGES, EXAMPLE), prefix), tmp_path, environment, monkeypatch)


@pytest.mark.slow
def test_colcon(copy, tmp_path, environment, monkeypatch):
    workspace = copy / "ros2_ws"
    colcon = [sys.executable, "-c", "import sys; from colcon_core.command import main; sys.exit(main())"]
    succeed([*colcon, "build", "--executor", "sequential"], workspace, environment)
    listing = succeed(["bash", "-c", ". install/setup.bash && env --null"], workspace, environment)
    sourced = dict(line.split("=", 1) for line in listing.split("\0") if line)
    files = where_imported(Path(sys.executable).name, tmp_path, sourced)
    assert all(workspace / "install" / p in file.parents for p, file in zip(PACKAGES, files, strict=True))
    assert_installed({p: workspace / "install" / p for p in (*PACKAGES, EXAMPLE)}, tmp_path, sourced, monkeypatch)
