"""Help waits for nothing that computes, draws or needs ROS. Counted in modules, so that a busy machine may run it."""

import subprocess
import sys

import pytest

from bmd_rths_core.identification.excitation import EXCITATION_KINDS
from bmd_rths_core.paper_figures.systems import FIGURES
from bmd_rths_core.stability.analysed_loops import AnalysisOptions
from bmd_rths_nodes.cli.figures import figures
from bmd_rths_nodes.cli.identify import identify
from bmd_rths_nodes.cli.main import COMMANDS
from bmd_rths_nodes.cli.stability import stability

#: What takes longer to import than the help may take altogether, and ROS.
SLOW = {
    *("numpy", "scipy", "filterpy", "matplotlib", "numba", "h5py", "pyarrow", "distributed", "rosbags", "mcap"),
    *("rclpy", "diagnostic_msgs", "ament_index_python"),
}

#: What `simulate --help` does without, besides; the other commands draw tables with it.
RICH = {"rich", "yaml"}


#: Show the help of some commands, each in a process of its own that had imported nothing but the entry point; tell
#: the top-level modules it has in the end.
HELPS = """
import os, sys
from bmd_rths_nodes.cli.main import main

for line in sys.argv[1].split(","):
    sys.stdout.flush()
    if os.fork() == 0:
        sys.argv = ["bmd-rths", *line.split(), "--help"]
        print("----")
        status = main()
        sys.stdout.flush()
        print(line or "bmd-rths", *{name.partition(".")[0] for name in sys.modules}, file=sys.stderr, flush=True)
        os._exit(status)
    assert os.wait()[1] == 0, line
"""


@pytest.fixture(scope="module")
def imported():
    """Return the top-level modules that the help of every command has imported when it ends."""
    done = subprocess.run([sys.executable, "-c", HELPS, ",".join(["", *COMMANDS])], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Usage: bmd-rths") == done.stdout.count("----") == len(COMMANDS) + 1
    return {command: set(modules) for command, *modules in map(str.split, done.stderr.splitlines())}


def test_help_imports_nothing_slow(imported):
    assert set(imported) == {"bmd-rths", *COMMANDS}
    assert {command: modules & SLOW for command, modules in imported.items() if modules & SLOW} == {}


def test_help_of_simulate_is_the_fastest(imported):
    assert imported["simulate"] & (SLOW | RICH) == set()


def option(command, name):
    return next(parameter for parameter in command.params if parameter.name == name)


def test_what_the_help_says_without_the_core_is_what_the_core_has():
    assert tuple(option(identify, "excitation").type.choices) == EXCITATION_KINDS
    assert sorted(map(int, option(figures, "only").help.removeprefix("Some of ").rstrip(".").split(","))) == sorted(
        FIGURES
    )
    assert option(stability, "modes").default == AnalysisOptions().modes
