"""What is no bag, and what cannot be read of one, is refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.writer import Writer

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.topics import COMMAND
from tests.msgs.bags import FINISHED, bag_of


def test_a_bag_of_which_nothing_can_be_read_is_refused(tmp_path: Path) -> None:
    messages = [(COMMAND, b"\x28\xb5\x2f\xfd compressed one by one")] * 40
    with pytest.raises(InputError, match="none of its 40 messages can be read, the first of /rths/command"):
        read_bag(bag_of(tmp_path / "run", messages))


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/urandom"])
def test_a_file_without_an_end_is_refused(path: str) -> None:
    with pytest.raises(InputError, match="is no regular file"):
        read_bag(path)


def test_a_huge_file_is_not_read_into_memory(tmp_path: Path) -> None:
    path = tmp_path / "huge.mcap"
    with path.open("wb") as stream:
        stream.truncate(10**13)  # sparse: more than any memory
    with pytest.raises(InputError, match="not a bag of bmd_rths"):
        read_bag(path)


@pytest.mark.parametrize(
    ("end", "problem"),
    [
        ({"outcome": "well"}, "outcome 'well' is unknown"),
        ({"outcome": "finished", "timing": "{"}, "timing: not JSON"),
        ({"outcome": "finished", "timing": "{}"}, "timing: KeyError"),
        ({"outcome": "finished", "timing": "[]"}, "timing: .* is not a JSON object"),
    ],
)
def test_an_unreadable_end_is_refused(tmp_path: Path, end: dict[str, str], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        read_bag(bag_of(tmp_path / "run", [], end))


@pytest.mark.parametrize(
    ("configuration", "problem"),
    [
        ("", "configuration: not JSON"),
        ("[1]", "not a JSON object"),
        ("{}", "run.time_step is missing"),
        ('{"run": 3}', "run.time_step is missing"),
        ('{"run": {"time_step": "fast"}}', "run.time_step: 'fast' is not a number"),
        ('{"run": {"time_step": -1.0}}', "run.time_step: -1"),
    ],
)
def test_an_unreadable_story_is_refused(tmp_path: Path, configuration: str, problem: str) -> None:
    BagWriter(tmp_path / "run", metadata={"configuration": configuration}).close(FINISHED)
    with pytest.raises(InputError, match=problem) as caught:
        read_bag(tmp_path / "run")
    assert str(caught.value).startswith(f"{tmp_path / 'run'}: ")


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("not a bag\n" * 100)
    (tmp_path / "empty").mkdir()
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "metadata.yaml").write_text("a: [")
    with (tmp_path / "foreign" / "foreign_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        writer.finish()
    problems = {
        "missing": "No such file",
        "missing/file.mcap": "No such file",
        "text.mcap": "not a bag of bmd_rths",
        "empty": "no .mcap file",
        "foreign": "not a bag of bmd_rths",
    }
    for name, problem in problems.items():
        with pytest.raises(InputError, match=problem) as caught:
            read_bag(tmp_path / name)
        assert str(caught.value).startswith(f"{tmp_path / name}: ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("yaml_text", ["a: [", "a: 1", "[]", "rosbag2_bagfile_information: {custom_data: null}"])
def test_a_foreign_metadata_yaml_does_no_harm(tmp_path: Path, yaml_text: str) -> None:
    (tmp_path / "metadata.yaml").write_text(yaml_text)
    (tmp_path / "bag_0.mcap").write_bytes(b"")
    with pytest.raises(InputError, match="not a bag of bmd_rths"):
        read_bag(tmp_path)
