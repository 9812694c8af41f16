"""Everything that needs no graph works where no package of ROS is installed.

The environment is a real one, made without a network: a fresh venv in which the distributions that the three packages
require, and theirs, are linked from the environment of the tests, and nothing else. pip installs the wheels of the
three folders into it with their requirements checked and no index, so a requirement of ROS would fail here.
"""

import ast
import json
import os
import signal
import subprocess
import sys
import urllib.request
from functools import partial
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from packaging.requirements import Requirement

from bmd_rths_core.config import load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.cli.main import COMMANDS
from tests.conftest import made_once

ROOT = Path(__file__).parents[2]
DATA = ROOT / "bmd_rths_core" / "bmd_rths_core" / "data"
PACKAGES = ("bmd_rths_core", "bmd_rths_msgs_py", "bmd_rths_nodes")

#: What installs the wheels of the three folders.
BUILD = ("pip",)

#: Variables that lead to ROS or to this checkout, the last set by the start-up code of the ROS wheels.
NOT_INHERITED = ("PYTHONPATH", "PYTHONHOME", "AMENT_PREFIX_PATH", "ROS_DISTRO", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")

pytestmark = pytest.mark.slow

SHORT = ("--set", "ground_motion.duration=1.0")


def declared(package):
    """Return what setup.py of a package requires of everybody."""
    tree = ast.parse((ROOT / package / "setup.py").read_text())
    return next(
        ast.literal_eval(node.value) for node in ast.walk(tree) if getattr(node, "arg", None) == "install_requires"
    )


def closure(names):
    """Return the distributions behind some requirements and those that they require in turn, by name."""
    found, left = {}, list(names)
    while left:
        requirement = Requirement(left.pop())
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        if requirement.name in found or requirement.name in PACKAGES:
            continue
        found[requirement.name] = installed = distribution(requirement.name)
        left += installed.requires or ()
    return found


def link(installed, site_packages):
    """Link the files of a distribution; scripts, which stand beside site-packages, are left out."""
    tops = {file.parts[0] for file in installed.files if file.parts[0] not in ("..", "__pycache__")}
    for top in tops:
        here, there = site_packages / top, Path(installed.locate_file(top))
        if not here.exists():
            here.symlink_to(there)


@pytest.fixture(scope="module")
def offline(wheels, tmp_path_factory):
    """Make the environment; return a function that runs its Python or its `bmd-rths`."""
    environment = {name: value for name, value in os.environ.items() if name not in NOT_INHERITED}
    environment["OPENBLAS_NUM_THREADS"] = "1"

    def run(*arguments, folder, program="bmd-rths", status=0):
        command = [str(folder / "venv" / "bin" / program), *(str(argument) for argument in arguments)]
        done = subprocess.run(
            command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=300
        )
        assert done.returncode == status, done.stdout + done.stderr
        return done

    def make(folder):
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], env=environment, check=True)
        (site_packages,) = folder.glob("venv/lib/python*/site-packages")
        for installed in closure([*BUILD, *(name for package in PACKAGES for name in declared(package))]).values():
            link(installed, site_packages)
        install = ("-m", "pip", "install", "--no-index", "--no-cache-dir", "--find-links", wheels, *PACKAGES)
        run(*install, folder=folder, program="python")

    folder = made_once(tmp_path_factory, "offline", make)
    ready = partial(run, folder=folder)
    ready.folder, ready.environment = folder, environment
    return ready


@pytest.fixture(scope="module")
def bag(offline, tmp_path_factory):
    """Record a short test there."""
    done = offline("simulate", "simplified_bmd", *SHORT, "--output", tmp_path_factory.mktemp("bags"), "--json")
    return Path(json.loads(done.stdout)["bag"])


def test_no_wheel_of_ros_is_required():
    names = closure(name for package in PACKAGES for name in declared(package))
    assert {"numpy", "rosbags", "click"} <= set(names)
    assert [name for name in names if name.startswith(("ros-", "rclpy", "ament"))] == []


def test_the_environment_has_no_ros(offline):
    code = "import importlib.metadata as m; print(*(d.name for d in m.distributions()))"
    names = set(offline("-c", code, program="python").stdout.split())
    assert set(PACKAGES) <= names
    assert [name for name in names if name.startswith(("ros-", "ros_", "rclpy", "ament"))] == []
    for module in ("rclpy", "diagnostic_msgs", "ament_index_python"):
        assert "ModuleNotFoundError" in offline("-c", f"import {module}", program="python", status=1).stderr


def test_help_lists_every_command(offline):
    help_text = offline("--help").stdout
    assert all(f"\n  {name} " in help_text for name in COMMANDS)


def test_simulate_writes_the_same_bag(offline, bag):
    config = load_config(ROOT / "config" / "simplified_bmd.yaml").changed(ground_motion__duration=1.0)
    record = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    assert read_bag(bag).same_signals(record)


def test_analyze_and_its_reports(offline, bag):
    for ending in ("html", "pdf"):
        report = offline.folder / f"report.{ending}"
        assert json.loads(offline("analyze", bag, "--report", report, "--json").stdout)["outcome"] == "finished"
        assert report.stat().st_size > 10_000


def test_replay(offline, bag):
    assert json.loads(offline("replay", bag, "--json").stdout)["reproduced"] is True


def test_campaign_with_bags(offline):
    record = DATA / "el_centro_1940_ns.csv"
    output = ("--output", offline.folder / "campaign", "--bags", "--jobs", "2")
    done = offline("campaign", *SHORT, "--motions", record, "--schemes", "uc,plc_fc", *output, "--json")
    runs = json.loads(done.stdout)["runs"]
    assert [run["scheme"] for run in runs] == ["uc", "plc_fc"]
    assert all(read_bag(run["bag"]).outcome == "finished" for run in runs)


def test_export(offline, bag):
    file, bundle = offline.folder / "test.mat", offline.folder / "bundle"
    told = json.loads(offline("export", bag, "--output", file, "--bundle", bundle, "--json").stdout)
    assert (told["file"], told["bundles"]) == (str(file), [str(bundle)])
    assert scipy.io.loadmat(file, simplify_cells=True)["about"]["outcome"] == "finished"


def test_stability(offline):
    assert "verdict" in json.loads(offline("stability", "simplified_bmd", "--no-sensitivity", "--json").stdout)


def test_identify_on_the_simulated_table(offline):
    done = offline("identify", "simplified_bmd", "--what", "table", "--duration", "30", "--order", "3", "--json")
    assert np.isfinite(json.loads(done.stdout)["delay"]["ms"])


def test_motions(offline):
    (found,) = json.loads(offline("motions", DATA, "--json").stdout)["records"]
    assert found["file"].endswith("el_centro_1940_ns.csv")


def test_figures(offline):
    done = offline("figures", "simplified_bmd", "--only", "11", "--output", offline.folder / "figures", "--json")
    (figure,) = json.loads(done.stdout)["figures"]
    assert all(Path(offline.folder, file).is_file() for file in figure["files"])


def test_page_of_a_recording(offline, bag):
    """The page is in the installed package, with its scripts and the licence of the one that is not ours."""
    command = [offline.folder / "venv" / "bin" / "bmd-rths", "monitor", bag, "--json"]
    with subprocess.Popen(
        command, env=offline.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            url = json.loads(process.stdout.readline())["url"]
            for name, words in (("", b"<title>"), ("page.js", b"/api/view"), ("uplot/LICENSE", b"MIT License")):
                with urllib.request.urlopen(url + name, timeout=30) as answer:
                    assert words in answer.read()
            with urllib.request.urlopen(f"{url}api/recordings", timeout=30) as answer:
                assert [found["name"] for found in json.load(answer)["bags"]] == [bag.name]
        finally:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 0


def test_layouts_and_a_look_at_the_computer(offline):
    files = json.loads(offline("layouts", "--output", offline.folder / "layouts", "--json").stdout)["files"]
    assert all(Path(offline.folder, file).stat().st_size > 1000 for file in files)
    checks = {check["name"]: check for check in json.loads(offline("doctor", "--quick", "--json").stdout)["checks"]}
    assert (checks["ROS 2"]["level"], checks["ROS 2"]["found"]) == ("note", "not installed")


def test_emulate(offline):
    command = [offline.folder / "venv" / "bin" / "bmd-rths", "emulate", "simplified_bmd", "--json"]
    with subprocess.Popen(
        [*command, "--listen", "udp://127.0.0.1:0"],
        env=offline.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert json.loads(process.stdout.readline())["port"] > 0
        finally:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert process.returncode == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "simplified_bmd"),
        ("monitor", "--once"),
        ("replay", "BAG", "--ros"),
        ("campaign", "--motions", "anything", "--ros"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_what_needs_the_graph_says_what_to_install(offline, bag, arguments):
    done = offline(*(bag if argument == "BAG" else argument for argument in arguments), status=2)
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    command = arguments[0] + (" --ros" if "--ros" in arguments else "")
    assert line.startswith(f"error: {command}: requires ROS 2 (No module named 'rclpy');")
    assert line.endswith("pip install 'bmd_rths_nodes[ros]'")


def test_a_requirement_that_is_not_installed_is_found():
    with pytest.raises(PackageNotFoundError):
        closure(["numpy", "bmd-rths-of-nobody"])
