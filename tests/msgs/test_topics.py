"""The table of topics agrees with itself, with the record and with the message definitions."""

from __future__ import annotations

from typing import Any

from bmd_rths_core.record import RunRecord
from bmd_rths_core.signals import SIGNALS
from bmd_rths_msgs_py.topics import EVERY_ROLE, RECORDER, ROLES, SCALAR_TOPICS, TOPICS, WAY_TO_REST_TOPICS


def test_every_role_of_a_topic_is_a_role() -> None:
    for topic in TOPICS.values():
        assert topic.producer in (*ROLES, EVERY_ROLE)
        assert set(topic.consumers) <= set(ROLES)
        assert topic.producer not in topic.consumers


def test_the_recorder_listens_to_everything() -> None:
    assert all(RECORDER in topic.consumers for topic in TOPICS.values())


def test_the_topics_close_the_loop() -> None:
    """Following the consumers from the desired acceleration leads through every stage and back."""
    arrows = {(topic.producer, consumer) for topic in TOPICS.values() for consumer in topic.consumers}
    stages = ROLES[:-1]
    assert {(a, b) for a, b in zip(stages, (*stages[1:], stages[0]), strict=True)} <= arrows


def test_names() -> None:
    assert TOPICS["command"].full_name == "/rths/command"
    assert TOPICS["/diagnostics"].full_name == "/diagnostics"


def test_every_scalar_topic_is_a_signal_of_the_record(record: RunRecord) -> None:
    assert {topic.name for topic in SCALAR_TOPICS} <= set(record.signals())


def test_every_type_exists(typestore: Any) -> None:
    assert all(topic.type_name in typestore.types for topic in TOPICS.values())


def test_every_signal_travels_on_a_topic_that_states_its_unit() -> None:
    for signal in SIGNALS:
        topic = TOPICS[signal.topic]
        assert f"[{signal.unit.replace('²', '2')}]" in topic.description
    assert [topic.name for topic in SCALAR_TOPICS] == [signal.name for signal in SIGNALS if not signal.measured]
    rest = {topic.name for topic in WAY_TO_REST_TOPICS}
    assert set(TOPICS) == {signal.topic for signal in SIGNALS} | rest | {"/diagnostics"}
