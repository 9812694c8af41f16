"""Write a rosbag2 directory (MCAP and metadata.yaml) that survives the death of its writer."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_description import END_RECORD, START_RECORD
from bmd_rths_msgs_py.message_definitions import message_definition

NO_START = 2**63 - 1  # starting_time of a bag without messages, as rosbag2 writes it

_FOREVER = {"sec": 9223372036, "nsec": 854775807}  # 2**63 - 1 ns, RMW_DURATION_INFINITE
#: What rosbag2 records of a reliable publisher under Fast DDS, which does not tell history and depth.
_OFFERED_QOS = [
    {
        "history": "unknown",
        "depth": 0,
        "reliability": "reliable",
        "durability": "volatile",
        "deadline": _FOREVER,
        "lifespan": _FOREVER,
        "liveliness": "automatic",
        "liveliness_lease_duration": _FOREVER,
        "avoid_ros_namespace_conventions": False,
    }
]


class BagWriter:
    """A rosbag2 directory ``<directory>`` with ``<name>_0.mcap`` and ``metadata.yaml``, open for writing.

    Both files exist, with the story of the run so far, when the constructor returns. Messages reach the operating
    system at most `flush_period` after they are written, by the log times of the messages that follow; call `flush`
    from a timer so that this also holds when no message follows.

    Parameters
    ----------
    directory : Path
        Where to write. It is made unless it exists and is empty.
    metadata : Mapping of str to str
        The story of the run at its start, see `bag_description.start_metadata`.
    chunk_size : int
        Largest MCAP chunk [bytes]: what a reader of a cut file may lose.
    flush_period : float
        Longest time by the log times that a message waits in memory [s].

    Raises
    ------
    InputError
        The directory is not empty or cannot be written.
    """

    def __init__(
        self, directory: Path, *, metadata: Mapping[str, str], chunk_size: int = 16 * 1024, flush_period: float = 0.1
    ) -> None:
        self._directory = directory
        self._file_name = f"{directory.resolve().name}_0.mcap"
        self._custom_data = dict(metadata)
        self._flush_period_ns = round(flush_period * 1e9)
        self._flushed_ns = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._types: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._first_ns = NO_START
        self._last_ns = 0
        try:
            directory.mkdir(parents=True, exist_ok=True)
            if any(directory.iterdir()):
                raise InputError(f"{directory}: not empty; a new or an empty directory is required")
            with ExitStack() as on_failure:
                self._file = on_failure.enter_context((directory / self._file_name).open("xb"))
                self._begin(metadata, chunk_size)
                on_failure.pop_all()
        except OSError as error:
            raise InputError(f"{directory}: cannot be written: {error.strerror}") from error

    def _begin(self, metadata: Mapping[str, str], chunk_size: int) -> None:
        """Write what both files have before the first message."""
        self._writer = Writer(self._file, chunk_size=chunk_size, compression=CompressionType.NONE)
        # The library keeps an object of 1 kB for each chunk until the end, 1.2 MB a minute of a test.
        self._writer._Writer__chunk_indices = _PackedChunkIndices()  # type: ignore[attr-defined]
        self._writer.start("ros2", f"bmd_rths, mcap {version('mcap')}")
        self.add_metadata(START_RECORD, metadata)
        self.flush()
        self._write_yaml(self._information())

    def write(self, topic: str, type_name: str, data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Write one message.

        Parameters
        ----------
        topic : str
            Absolute name of the topic.
        type_name : str
            Type of the topic, for example ``"geometry_msgs/msg/AccelStamped"``.
        data : bytes
            The message as CDR with encapsulation.
        log_time_ns, publish_time_ns : int
            When it was received and published [ns], not negative.

        Raises
        ------
        OSError
            The disk does not take it.
        """
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._add_channel(topic, type_name)
        self._writer.add_message(channel, log_time_ns, data, publish_time_ns)
        self._counts[topic] += 1
        self._first_ns = min(self._first_ns, log_time_ns)
        self._last_ns = max(self._last_ns, log_time_ns)
        if not 0 <= log_time_ns - self._flushed_ns < self._flush_period_ns:  # also when the clock was set back
            self._flushed_ns = log_time_ns
            self.flush()

    def add_metadata(self, name: str, mapping: Mapping[str, str]) -> None:
        """Write an MCAP metadata record.

        Parameters
        ----------
        name : str
            Name of the record.
        mapping : Mapping of str to str
            Its content.
        """
        self._writer.add_metadata(name, dict(mapping))

    def flush(self) -> None:
        """Hand everything written so far to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self, custom_data: Mapping[str, str]) -> None:
        """Write how the run ended, the index and the final ``metadata.yaml``.

        Parameters
        ----------
        custom_data : Mapping of str to str
            How the run ended, see `bag_description.end_metadata`.
        """
        self.flush()  # the record of the end stands behind every message
        self.add_metadata(END_RECORD, custom_data)
        self._custom_data.update(custom_data)
        information = self._information()
        self.add_metadata("rosbag2", {"serialized_metadata": _yaml(information)})
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()
        self._write_yaml(information)

    def _add_channel(self, topic: str, type_name: str) -> int:
        text, type_hash = message_definition(type_name)
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", text.encode())
        metadata = {"offered_qos_profiles": _offered_qos(), "topic_type_hash": type_hash}
        self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[type_name], metadata)
        self._types[topic] = type_name
        self._counts[topic] = 0
        return self._channels[topic]

    def _information(self) -> dict[str, Any]:
        """Return the content of ``metadata.yaml``, as rosbag2 of Jazzy writes it (version 9)."""
        count = sum(self._counts.values())
        span = {
            "starting_time": {"nanoseconds_since_epoch": self._first_ns},
            "duration": {"nanoseconds": self._last_ns - self._first_ns if count else 0},
            "message_count": count,
        }
        topics = [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": _OFFERED_QOS,
                    "type_description_hash": message_definition(type_name)[1],
                },
                "message_count": self._counts[topic],
            }
            for topic, type_name in self._types.items()
        ]
        return {
            "version": 9,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._file_name],
            "files": [{"path": self._file_name, **span}],
            "custom_data": self._custom_data,
            "ros_distro": "jazzy",
        }

    def _write_yaml(self, information: Mapping[str, Any]) -> None:
        """Replace ``metadata.yaml`` in one go, so that a reader never finds half of it."""
        temporary = self._directory / "metadata.yaml.tmp"
        temporary.write_text(_yaml({"rosbag2_bagfile_information": information}), encoding="utf-8")
        os.replace(temporary, self._directory / "metadata.yaml")


class _PackedChunkIndices:
    """The index of the chunks as the bytes that end up in the file; the writer appends to it, and iterates once."""

    def __init__(self) -> None:
        self._packed = bytearray()

    def append(self, index: ChunkIndex) -> None:
        builder = RecordBuilder()
        index.write(builder)
        self._packed += builder.end()  # type: ignore[no-untyped-call]

    def __iter__(self) -> Iterator[_PackedChunkIndices]:
        return iter((self,) if self._packed else ())

    def write(self, builder: RecordBuilder) -> None:
        builder.write(bytes(self._packed))


class _PlainDumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """YAML as rosbag2 writes it: without anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


@functools.cache
def _offered_qos() -> str:
    return _yaml(_OFFERED_QOS).strip()


def _yaml(content: Any) -> str:
    text: str = yaml.dump(content, Dumper=_PlainDumper, sort_keys=False, default_flow_style=False, width=2**31 - 1)
    return text
