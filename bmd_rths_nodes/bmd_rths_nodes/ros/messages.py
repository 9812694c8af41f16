"""How the messages of a topic are made and read."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from bmd_rths_core.config import Config
from bmd_rths_msgs_py.cdr import MeasurementCodec, ScalarCodec
from bmd_rths_msgs_py.topics import MEASUREMENT, Topic


def message_class(topic: Topic) -> type:
    """Return the ROS message class of a topic."""
    package, _, name = topic.type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def codec_of(topic: Topic, config: Config) -> Any:
    """Return the codec of a topic of the loop."""
    if topic is MEASUREMENT:
        return MeasurementCodec(len(config.specimen.masses), config.run.time_step_ns, topic.frame_id)
    return ScalarCodec(topic.frame_id)
