"""Bags in several files, and under other names: read whole, told as incomplete, or refused."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.record_bag import write_record
from tests.msgs.bags import Make, Same, split

# ---- files


def test_a_split_bag_is_read_whole(make_record: Make, same: Same, tmp_path: Path) -> None:
    bag = write_record(make_record(30), tmp_path / "run")
    assert same(read_bag(split(bag, tmp_path / "split", 12)), read_bag(bag))  # run_10 comes after run_2


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_split_bag_without_one_of_its_files_is_told_as_incomplete(bag: Path, tmp_path: Path, lost: int) -> None:
    folder = split(bag, tmp_path / "split", 3)
    (folder / f"run_{lost}.mcap").unlink()
    found = read_bag(folder)
    assert found.outcome == "cut"
    missing = 1400 * (lost + 1) // 3 - 1400 * lost // 3
    assert f"the recording is incomplete: {missing} of 1400 messages of signals" in found.reason
    assert ("and so is the file 'run_0.mcap'" in found.reason) == (lost == 0)


def test_an_excerpt_with_all_its_metadata_is_told_as_incomplete(bag: Path, tmp_path: Path) -> None:
    folder = split(bag, tmp_path / "split", 2)
    (folder / "run_1.mcap").unlink()
    (folder / "metadata.yaml").unlink()
    found = read_bag(folder)
    assert found.outcome == "cut"
    assert "700 of 1400 messages of signals, as its metadata count them, are missing" in found.reason


def test_two_runs_in_one_folder_are_refused(bag: Path, make_record: Make, tmp_path: Path) -> None:
    for name, record in (("other", replace(make_record(50), motion={"name": "b"})), ("same", make_record(200, seed=1))):
        folder = write_record(record, tmp_path / name)
        shutil.copy(bag / "run_0.mcap", folder / "zz_1.mcap")
        with pytest.raises(InputError, match="two runs in one folder"):
            read_bag(folder)


def test_a_bag_without_its_motion_is_refused(bag: Path, tmp_path: Path) -> None:
    def without(story: dict[str, str]) -> dict[str, str]:
        return {key: value for key, value in story.items() if key != "motion"}

    with pytest.raises(InputError, match="has no entry 'motion'"):
        read_bag(split(bag, tmp_path / "split", 1, change=without))


# ---- names


@pytest.mark.parametrize("namespace", ["/lab/rths", "/lab", "/a/b/c"])
def test_signals_under_another_namespace_are_read(bag: Path, same: Same, tmp_path: Path, namespace: str) -> None:
    folder = split(bag, tmp_path / "split", 1, rename=lambda topic: topic.replace("/rths", namespace))
    assert read_bag(folder).same_signals(read_bag(bag))
    assert read_bag(folder).outcome == "finished"


def test_topics_without_a_signal_are_listed(bag: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no signal of a test in it; topics found: '/rths/command_x'"):
        read_bag(split(bag, tmp_path / "split", 1, rename=lambda topic: topic + "_x"))


def test_signals_in_two_namespaces_are_refused(bag: Path, tmp_path: Path) -> None:
    def rename(topic: str) -> str:
        return topic.replace("/rths", "/one" if topic.endswith("command") else "/two")

    with pytest.raises(InputError, match="signals in 2 namespaces, '/one', '/two'"):
        read_bag(split(bag, tmp_path / "split", 1, rename=rename))
