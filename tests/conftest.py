"""What all tests share."""

from __future__ import annotations

import fcntl
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

# As the programs do, before numpy is imported: on a busy machine the threads of the linear algebra wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Some hundred processes are started: none of them shall compile the sources again, nor the next run the tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Helpers that tests share say what was compared, as tests do.
pytest.register_assert_rewrite("tests.clock", "tests.core", "tests.faults", "tests.msgs", "tests.nodes")

# How long an example takes says more about what else the machine does than about the code. Daily work draws a quarter
# of the examples, and others each time.
settings.register_profile("whole", deadline=None, max_examples=100)
settings.register_profile("daily", deadline=None, max_examples=25)


def pytest_configure(config: pytest.Config) -> None:
    """Draw fewer examples where slow tests are left out."""
    settings.load_profile("daily" if config.option.markexpr == "not slow" else "whole")


def examples(number: int) -> int:
    """Return how many examples of a property are drawn, where it is `number` in a whole run."""
    return max(1, round(number * settings().max_examples / 100))


#: Changes of a configuration: nothing stops the table but a value that is not finite.
WITHOUT_LIMITS = {
    f"safety__{limit}_action": "ignore"
    for limit in ("displacement", "velocity", "acceleration", "force", "increment", "tracking", "stability")
}

#: Changes of a configuration: a servo table for tests whose numbers belong to it, whatever table is the default.
SERVO_TABLE = {
    "simulated_table__dynamics": "servo",
    "simulated_table__servo_real_pole": 49.6,
    "simulated_table__servo_frequency": 183.6,
    "simulated_table__servo_damping_ratio": 0.167,
}


def ground_motion_folder() -> Path:
    """Return where the real records are: they belong to their agencies and are no part of this repository."""
    beside_the_repository = Path(__file__).resolve().parents[2] / "shared" / "ground_motions"
    return Path(os.environ.get("BMD_RTHS_GROUND_MOTIONS", beside_the_repository))


def needs(record: Path) -> pytest.MarkDecorator:
    """Return the mark of a test with real records, which is skipped where they are not."""
    reason = f"no {record}: real records belong to their agencies; BMD_RTHS_GROUND_MOTIONS names their folder"
    return pytest.mark.skipif(not record.exists(), reason=reason)


def made_once(tmp_path_factory: pytest.TempPathFactory, name: str, make: Callable[[Path], None]) -> Path:
    """Return a folder that is made by whichever worker of pytest-xdist comes first; the others wait for it.

    Parameters
    ----------
    tmp_path_factory : pytest.TempPathFactory
        Of the session.
    name : str
        Name of the folder.
    make : callable
        Fills the folder, which is empty.
    """
    shared = tmp_path_factory.getbasetemp()
    shared = shared.parent if "PYTEST_XDIST_WORKER" in os.environ else shared
    folder, made = shared / name, shared / f"{name}_is_made"
    with open(shared / f"{name}_lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            shutil.rmtree(folder, ignore_errors=True)  # of a worker that failed in the middle
            folder.mkdir()
            make(folder)
            made.touch()
    return folder


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the long tests."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
