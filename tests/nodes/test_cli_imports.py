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


def imported_by(*arguments):
    """Return the top-level modules a command has imported when it ends."""
    code = (
        "import sys; from bmd_rths_nodes.cli.main import main; main(); "
        "print(*{name.partition('.')[0] for name in sys.modules}, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    assert "Usage: bmd-rths" in done.stdout
    return set(done.stderr.split())


@pytest.mark.parametrize("command", [(), *((name,) for name in COMMANDS)], ids=lambda command: " ".join(command))
def test_help_imports_nothing_slow(command):
    assert imported_by(*command, "--help") & SLOW == set()


def test_help_of_simulate_is_the_fastest():
    assert imported_by("simulate", "--help") & (SLOW | RICH) == set()


def option(command, name):
    return next(parameter for parameter in command.params if parameter.name == name)


def test_what_the_help_says_without_the_core_is_what_the_core_has():
    assert tuple(option(identify, "excitation").type.choices) == EXCITATION_KINDS
    assert sorted(map(int, option(figures, "only").help.removeprefix("Some of ").rstrip(".").split(","))) == sorted(
        FIGURES
    )
    assert option(stability, "modes").default == AnalysisOptions().modes
