"""How the messages of a topic are made and read."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from bmd_rths_core.config import Config
from bmd_rths_msgs_py.cdr import MeasurementCodec, PairCodec, ScalarCodec
from bmd_rths_msgs_py.topics import (
    COMMAND_SHAPER,
    DESIRED_ACCELERATION,
    MEASUREMENT,
    NUMERICAL_SUBSTRUCTURE,
    RECORDER,
    WAY_TO_REST_MEASUREMENT,
    Topic,
)


def message_class(topic: Topic) -> type:
    """Return the ROS message class of a topic."""
    package, _, name = topic.type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def codec_of(topic: Topic, config: Config) -> Any:
    """Return the codec of a topic of the loop."""
    if topic in (MEASUREMENT, WAY_TO_REST_MEASUREMENT):
        return MeasurementCodec(len(config.specimen.masses), config.run.stamps, topic.frame_id)
    if topic is DESIRED_ACCELERATION and owns_the_interface(config):
        return PairCodec(topic.frame_id)
    return ScalarCodec(topic.frame_id)


def owns_the_interface(config: Config) -> bool:
    """Tell whether the compensator makes the command with the desired acceleration, from the measurements."""
    return config.compensator.control is not None


def shaper_learns(config: Config) -> bool:
    """Tell whether the command shaper takes in measurements."""
    return config.compensator.shaper is not None and config.compensator.learns


def consumers_of(topic: Topic, config: Config) -> set[str]:
    """Return the roles that have to listen to a topic before step 0."""
    needed = {role for role in topic.consumers if role != RECORDER or config.run.record}
    if topic is MEASUREMENT and owns_the_interface(config):
        needed.add(NUMERICAL_SUBSTRUCTURE)
    if topic is MEASUREMENT and shaper_learns(config):
        needed.add(COMMAND_SHAPER)
    return needed
