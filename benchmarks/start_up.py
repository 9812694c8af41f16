"""How long the command line takes to answer a question for help: python benchmarks/start_up.py.

Prints the median of some starts for `bmd-rths --help` and for the help of every command, and beside it that of an
interpreter that does nothing. Run it on an idle machine; the slowest imports of a command are shown by
`python -X importtime -m bmd_rths_nodes.cli.main simulate --help`.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time

from bmd_rths_nodes.cli.main import COMMANDS

#: What the help of `simulate` may take on an idle core [s].
GOAL = 0.3


def median_time(arguments: list[str], starts: int) -> float:
    """Return the median duration of a Python process [s]."""
    durations = []
    for _ in range(starts):
        begin = time.perf_counter()
        subprocess.run([sys.executable, *arguments], stdout=subprocess.DEVNULL, check=True)
        durations.append(time.perf_counter() - begin)
    return statistics.median(durations)


def main() -> int:
    """Measure and print; 1 when the help of `simulate` is slower than the goal."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=9, help="starts of each [9]")
    starts = parser.parse_args().starts
    print(f"interpreter alone {median_time(['-c', 'pass'], starts):.3f} s")
    cli = ["-m", "bmd_rths_nodes.cli.main"]
    print(f"bmd-rths --help {median_time([*cli, '--help'], starts):.3f} s")
    measured = {name: median_time([*cli, name, "--help"], starts) for name in COMMANDS}
    for name, duration in measured.items():
        print(f"bmd-rths {name} --help {duration:.3f} s")
    return int(measured["simulate"] > GOAL)


if __name__ == "__main__":
    sys.exit(main())
