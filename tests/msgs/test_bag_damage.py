"""Of a bag that is cut or damaged anywhere, its beginning is read; it is told to be no whole one."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer

from bmd_rths_core.errors import InputError
from bmd_rths_core.record import RunRecord
from bmd_rths_msgs_py.bag_description import start_metadata
from bmd_rths_msgs_py.bag_reader import bag_is_whole, read_bag
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import ScalarCodec
from tests.msgs.bags import CONFIGURATION, STEP_NS, assert_prefix, bag_of, command


@pytest.mark.slow
def test_truncated_anywhere_a_bag_gives_its_beginning(bag: Path, record: RunRecord, tmp_path: Path) -> None:
    data = (bag / "run_0.mcap").read_bytes()
    rng = random.Random(2)
    story_end = data.index(b'{"bmd_rths": "0.1.0"}') + len(b'{"bmd_rths": "0.1.0"}')  # the last words of the record
    at_random = (rng.randrange(len(data)) for _ in range(200))
    offsets = sorted({0, 1, 8, story_end - 1, story_end, len(data) - 1, *at_random})
    cut = tmp_path / "cut.mcap"
    steps = cuts = 0
    for offset in offsets:
        cut.write_bytes(data[:offset])
        if offset < story_end:
            with pytest.raises(InputError, match="cut before its first record"):
                read_bag(cut)
            continue
        found = read_bag(cut)
        assert_prefix(found, record)
        assert found.steps >= steps, "a longer file cannot say less"
        steps = found.steps
        assert found.outcome in ("cut", "finished")
        if found.outcome == "cut":
            cuts += 1
            assert found.reason.endswith(f"the recording is cut or damaged after {steps} steps ({steps * 0.005:.3f} s)")
    assert cuts > 100
    assert steps == record.steps


def test_a_truncated_file_in_a_bag_has_its_story_in_metadata_yaml(bag: Path, record: RunRecord) -> None:
    (bag / "run_0.mcap").write_bytes(b"")
    found = read_bag(bag)
    assert found.steps == 0
    assert found.outcome == "cut"
    assert found.configuration == record.configuration


def test_a_damaged_byte_ends_the_reading_but_not_the_reader(bag: Path, record: RunRecord) -> None:
    data = bytearray((bag / "run_0.mcap").read_bytes())
    at = data.index(ScalarCodec("world").pack(100 * STEP_NS, record.command[100])) + 40
    data[at] ^= 1
    (bag / "run_0.mcap").write_bytes(data)
    found = read_bag(bag)
    assert_prefix(found, record)
    assert 80 <= found.steps <= 101  # the chunk with the damage may begin in the middle of step 100
    assert found.outcome == "cut"


@pytest.mark.slow
def test_no_damage_makes_the_reader_fail(bag: Path, record: RunRecord, tmp_path: Path) -> None:
    data = (bag / "run_0.mcap").read_bytes()
    rng = random.Random(3)
    damaged = tmp_path / "damaged.mcap"
    refused = read = 0
    for _ in range(300):
        copy = bytearray(data)
        at = rng.randrange(1000 if rng.random() < 0.5 else len(data))
        copy[at : at + 4] = rng.randbytes(4)
        damaged.write_bytes(copy)
        try:
            found = read_bag(damaged)
        except InputError:
            refused += 1
        else:
            assert found.steps <= record.steps
            read += 1
    assert refused > 10
    assert read > 10


WRITE_UNTIL_KILLED = """
import itertools, sys
from pathlib import Path
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import ScalarCodec
from bmd_rths_msgs_py.bag_description import start_metadata
from bmd_rths_msgs_py.topics import SCALAR_TOPICS

metadata = start_metadata({"run": {"time_step": 0.005}}, {}, {})
writer = BagWriter(Path(sys.argv[1]), metadata=metadata)
codec = ScalarCodec("world")
for step in itertools.count():
    for topic in SCALAR_TOPICS:
        log_time_ns = 1_700_000_000_000_000_000 + step * 5_000_000
        writer.write(topic.full_name, topic.type_name, codec.pack(step * 5_000_000, float(step)), log_time_ns, 0)
    print(step, flush=True)
"""


@pytest.mark.slow
def test_after_sigkill_at_most_the_flush_period_is_lost(tmp_path: Path) -> None:
    bag = tmp_path / "run"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(
        [sys.executable, "-c", WRITE_UNTIL_KILLED, str(bag)], stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        for _ in range(1993):
            line = process.stdout.readline()
        process.kill()
        written = [int(line), *(int(rest) for rest in process.stdout.read().split("\n")[:-1])][-1]
    assert written >= 1992
    found = read_bag(bag)
    assert found.outcome == "cut"
    assert "cut or damaged" in found.reason
    assert written - (found.steps - 1) <= 20  # 0.1 s
    assert found.command[: found.steps - 1].tolist() == list(range(found.steps - 1))


def test_a_whole_bag_without_an_end_is_cut(tmp_path: Path) -> None:
    with (tmp_path / "recovered.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        writer.add_metadata("bmd_rths", start_metadata(CONFIGURATION, {}, {}))
        writer.finish()
    found = read_bag(tmp_path / "recovered.mcap")
    assert (found.outcome, found.reason) == ("cut", "the recording has no end; it holds 0 steps (0.000 s)")


def test_bag_is_whole_until_its_end_is_cut(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "bag", [command(step, 0.5) for step in range(10)])
    assert bag_is_whole(bag)
    (file,) = bag.glob("*.mcap")
    os.truncate(file, file.stat().st_size - 1)
    assert not bag_is_whole(bag)
    os.truncate(file, 3)
    assert not bag_is_whole(bag)
    file.unlink()
    assert not bag_is_whole(bag)
    assert not bag_is_whole(tmp_path / "none")


def test_bag_without_an_end_is_not_whole(tmp_path: Path) -> None:
    BagWriter(tmp_path / "bag", metadata=start_metadata(CONFIGURATION, {}, {})).flush()
    assert not bag_is_whole(tmp_path / "bag")
