"""What a bag says of its messages: text and hash of each type, as Jazzy has them, from no ROS installation.

Those of the topics of a test stand in ``message_definitions.json``, frozen from rosbags, which takes a tenth of a
second to load all types of Jazzy. ``python -m bmd_rths_msgs_py.message_definitions`` writes the file again.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path

from bmd_rths_msgs_py.topics import TOPICS

_FILE = Path(__file__).with_suffix(".json")


@functools.cache
def message_definition(type_name: str) -> tuple[str, str]:
    """Return the ros2msg text and the RIHS01 hash of a message type.

    Parameters
    ----------
    type_name : str
        For example ``"geometry_msgs/msg/AccelStamped"``.
    """
    frozen = _frozen().get(type_name)
    return generated_definition(type_name) if frozen is None else (frozen["text"], frozen["hash"])


def generated_definition(type_name: str) -> tuple[str, str]:
    """Return the same as rosbags generates it, for any type of Jazzy.

    Parameters
    ----------
    type_name : str
        For example ``"sensor_msgs/msg/Imu"``.
    """
    from rosbags.typesys import Stores, get_typestore

    typestore = get_typestore(Stores.ROS2_JAZZY)
    return typestore.generate_msgdef(type_name, ros_version=2)[0], typestore.hash_rihs01(type_name)


@functools.cache
def _frozen() -> dict[str, dict[str, str]]:
    frozen: dict[str, dict[str, str]] = json.loads(_FILE.read_text(encoding="utf-8"))
    return frozen


def _freeze() -> None:
    types = sorted({topic.type_name for topic in TOPICS.values()})
    frozen = {name: dict(zip(("hash", "text"), generated_definition(name)[::-1], strict=True)) for name in types}
    _FILE.write_text(json.dumps(frozen, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    _freeze()
