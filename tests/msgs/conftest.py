"""Records, messages and bags for the tests of the message package."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from bmd_rths_core.record import RunRecord, TimingStatistics
from bmd_rths_msgs_py.record_bag import write_record

TIME_STEP = 0.005


@pytest.fixture(scope="session")
def typestore() -> Any:
    """Message types and codecs of rosbags, which know nothing of ours."""
    return get_typestore(Stores.ROS2_JAZZY)


def _make_record(steps: int, floors: int = 3, seed: int = 0) -> RunRecord:
    """Return a finished run with random signals."""
    rng = np.random.default_rng(seed)
    names = (
        "ground_acceleration desired_acceleration required_force command applied_command table_acceleration "
        "table_displacement actuator_force base_shear interface_force corrected_force"
    )
    return RunRecord(
        time_step=TIME_STEP,
        **{name: rng.normal(size=steps) for name in names.split()},
        floor_accelerations=rng.normal(size=(steps, floors)),
        configuration={"run": {"time_step": TIME_STEP, "scheme": "plc_fc"}, "specimen": {"mass": [1.0, 2.0]}},
        motion={"name": "el_centro_1940_ns", "sha256": "0" * 64, "source": "shipped"},
        versions={"bmd_rths": "0.1.0"},
        outcome="finished",
        reason='it\'s the "end": über\nlines',
        timing=TimingStatistics(2, 1, (5, 17), 0, {"p50": 0.5, "p99": 1.25, "max": 3.0}),
    )


@pytest.fixture(scope="session")
def make_record() -> Callable[..., RunRecord]:
    """Make a finished run of `steps` steps and `floors` floors."""
    return _make_record


@pytest.fixture
def record() -> RunRecord:
    """Return a finished run of 200 steps on a table with three floors."""
    return _make_record(200)


@pytest.fixture
def bag(record: RunRecord, tmp_path: Path) -> Path:
    """Write the bag of `record`."""
    return write_record(record, tmp_path / "run")


@pytest.fixture
def same() -> Callable[[RunRecord, RunRecord], bool]:
    """Compare everything two records say except where they come from."""

    def compare(a: RunRecord, b: RunRecord) -> bool:
        blank = np.zeros(0)
        erased = [replace(r, source="", namespace="", **dict.fromkeys(r.signals(), blank)) for r in (a, b)]
        return a.same_signals(b) and str(erased[0]) == str(erased[1])

    return compare
