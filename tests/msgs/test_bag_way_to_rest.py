"""The way to rest in a bag comes back bit for bit, or its messages are told as missing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.record import RunRecord
from bmd_rths_core.rest_record import rest_record
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.cdr import MeasurementCodec
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_msgs_py.topics import MEASUREMENT, WAY_TO_REST_MEASUREMENT
from tests.msgs.bags import STAMPS, STEP_NS, Same, bag_of, measurement


def with_way_to_rest(record: RunRecord, first_step: int) -> RunRecord:
    """Return a record whose way to rest has a step without a command, one without an answer, and one without both."""
    n = record.floor_accelerations.shape[1]
    measured = {
        step: TableMeasurement(step, 1.0, 2.0, 3.0 * step, np.nan, 5.0, np.arange(n) + 6.0)
        for step in (first_step, first_step + 1, first_step + 4)
    }
    commands = {first_step: 0.5, first_step + 2: -0.25, first_step + 4: -0.0}
    return replace(record, way_to_rest=rest_record(commands, measured, n))


@pytest.mark.parametrize("first_step", [199, 200, 230])
def test_way_to_rest_comes_back_bit_for_bit(record: RunRecord, same: Same, tmp_path: Path, first_step: int) -> None:
    record = with_way_to_rest(record, first_step)
    found = read_bag(write_record(record, tmp_path / "run"))
    assert same(replace(found, way_to_rest=None), replace(record, way_to_rest=None))
    assert found.way_to_rest is not None
    assert found.way_to_rest.same_signals(record.way_to_rest)
    assert np.signbit(found.way_to_rest.command[-1])


def test_bag_of_a_way_to_rest_alone_is_one_of_no_step(record: RunRecord, tmp_path: Path) -> None:
    nothing = {name: values[:0] for name, values in record.signals().items()}
    whole = with_way_to_rest(record, 0)
    found = read_bag(write_record(replace(whole, **nothing), tmp_path / "run"))
    assert (found.steps, found.outcome) == (0, "finished")
    assert found.way_to_rest is not None
    assert found.way_to_rest.same_signals(whole.way_to_rest)


def test_older_bag_has_no_way_to_rest(bag: Path) -> None:
    found = read_bag(bag)
    assert (found.outcome, found.way_to_rest) == ("finished", None)
    assert np.array_equal(found.continued("command"), found.command)


def test_lost_message_of_the_way_to_rest_makes_a_bag_incomplete(record: RunRecord, tmp_path: Path) -> None:
    whole = write_record(with_way_to_rest(record, 200), tmp_path / "run")
    metadata = (whole / "metadata.yaml").read_text()
    cut = write_record(replace(record, way_to_rest=None), tmp_path / "cut")
    (cut / "metadata.yaml").write_text(metadata.replace("run_0.mcap", "cut_0.mcap"))
    found = read_bag(cut)
    assert found.outcome == "cut"
    assert "the recording is incomplete: 6 of 1406 messages of signals" in found.reason


def test_way_to_rest_of_another_number_of_floors_is_malformed(tmp_path: Path) -> None:
    measured = [(MEASUREMENT, MeasurementCodec(2, STAMPS).pack(0, measurement(2)))]
    strange = [(WAY_TO_REST_MEASUREMENT, MeasurementCodec(3, STAMPS).pack(STEP_NS, measurement(3)))]
    found = read_bag(bag_of(tmp_path / "run", measured + strange))
    assert found.way_to_rest is None
    assert found.reason.startswith("1 malformed messages were left out, the first of /rths/way_to_rest_measurement")
