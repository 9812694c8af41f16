"""The message definitions in a bag are frozen ones of rosbags; they are those that ROS 2 Jazzy ships."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from bmd_rths_msgs_py.message_definitions import generated_definition, message_definition
from bmd_rths_msgs_py.topics import TOPICS

TYPES = sorted({topic.type_name for topic in TOPICS.values()})

#: Field types of the language itself, which belong to no package.
BUILT_IN = re.compile(r"(bool|byte|char|string|wstring|float32|float64|u?int(8|16|32|64))\b")


def shipped(type_name: str, ending: str) -> str:
    """Return a file about a message type in the ROS installation of these tests."""
    package, name = type_name.split("/")[::2]
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        file = Path(prefix) / "share" / package / "msg" / f"{name}{ending}"
        if file.is_file():
            return file.read_text()
    pytest.skip(f"no ROS here: {package}/msg/{name}{ending} is in none of {prefixes}")


def fields(text: str, package: str) -> list[str]:
    """Return what a definition declares, without comments, with the package before every type, spaces as one."""
    lines = (re.sub(r"\s*=\s*", "=", " ".join(line.partition("#")[0].split())) for line in text.splitlines())
    return [line if BUILT_IN.match(line) or "/" in line else f"{package}/{line}" for line in lines if line]


@pytest.mark.parametrize("type_name", TYPES)
def test_hash(type_name: str) -> None:
    _, found = message_definition(type_name)
    hashes = {
        entry["type_name"]: entry["hash_string"] for entry in json.loads(shipped(type_name, ".json"))["type_hashes"]
    }
    assert found == hashes[type_name]


@pytest.mark.parametrize("type_name", TYPES)
def test_text(type_name: str) -> None:
    text, _ = message_definition(type_name)
    first, *others = text.split("=" * 80 + "\nMSG: ")
    parts = {type_name: first} | {name: body for name, _, body in (other.partition("\n") for other in others)}
    assert len(parts) == 1 + len(others)
    for name, body in parts.items():
        package, message = name.split("/")[0], name.split("/")[-1]
        assert fields(body, package) == fields(shipped(f"{package}/msg/{message}", ".msg"), package)


@pytest.mark.parametrize("type_name", TYPES)
def test_what_is_frozen_is_what_rosbags_generates(type_name: str) -> None:
    assert message_definition(type_name) == generated_definition(type_name)


def test_any_other_type_of_jazzy_is_there_too() -> None:
    text, found = message_definition("sensor_msgs/msg/Imu")
    assert "geometry_msgs/Vector3 linear_acceleration" in text
    assert found.startswith("RIHS01_")


def test_writing_a_bag_loads_no_types_of_rosbags() -> None:
    statement = """
import sys
from bmd_rths_msgs_py.bag_writer import message_definition
from bmd_rths_msgs_py.topics import TOPICS
assert all(message_definition(topic.type_name) for topic in TOPICS.values())
assert not [name for name in sys.modules if name.startswith("rosbags")]
"""
    assert subprocess.run([sys.executable, "-c", statement], timeout=120).returncode == 0
