"""Follow a bag while it is written; a finished one is read the same way, a piece at a time."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path

from mcap.records import Channel, DataEnd, Message, Metadata

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_description import END_RECORD, START_RECORD
from bmd_rths_msgs_py.bag_reader import bag_files, custom_data
from bmd_rths_msgs_py.growing_run import GrowingRun
from bmd_rths_msgs_py.mcap_records import MAX_RECORD, open_regular, records_until_damage

_MAGIC_SIZE = 8
_HEAD_SIZE = 9  # opcode, and length of the content as eight bytes

#: Most bytes that one look takes, so that whoever follows a bag has time for other things in between.
LARGEST_LOOK = 1_000_000


class BagFollower:
    """Take what was added to a bag since the last look.

    Nothing is locked and nothing is written: the recorder does not notice. A bag of several files is followed in the
    last one that was there at the first look, and read before that.

    Parameters
    ----------
    path : Path
        Bag directory or MCAP file.
    listener : callable, optional
        Called with topic, bytes and time of recording [ns] of every message, in the order of the file.

    Attributes
    ----------
    path : Path
        As given.
    run : GrowingRun or None
        The run; None before the bag has told what it is of.
    ended : bool
        True when there is nothing more to come: the writer has closed the bag.
    damaged : bool
        True when the rest of the bag cannot be read.

    Raises
    ------
    InputError
        There is no bag.
    """

    def __init__(self, path: Path, listener: Callable[[str, bytes, int], None] | None = None) -> None:
        self.path = path
        self._listener = listener
        self.run: GrowingRun | None = None
        self.ended = self.damaged = False
        self._files = bag_files(path)
        if not self._files[0].exists():
            raise InputError(f"{path}: no such bag")
        self._at = _MAGIC_SIZE
        self._topics: dict[int, str] = {}
        self._looked_for_story = False
        self._story: dict[str, str] = {}

    def look(self) -> bool:
        """Take what is new, at most `LARGEST_LOOK` bytes of it.

        Returns
        -------
        bool
            True when there may be more at once.

        Raises
        ------
        InputError
            It cannot be read, or is not a bag of this project.
        """
        if self.ended or self.damaged:
            return False
        try:
            with open_regular(self._files[0]) as stream:
                stream.seek(self._at)
                data = stream.read(LARGEST_LOOK)
                whole = _whole_records(data)
                if not whole and len(data) == LARGEST_LOOK:  # one record that is larger than a look
                    data += stream.read(MAX_RECORD)
                    whole = _whole_records(data)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror}") from error
        self._take(data[:whole])
        self._at += whole
        return whole > 0 and not self.ended

    def _take(self, data: bytes) -> None:
        run = self.run
        for record in records_until_damage(BytesIO(data), whole_file=False):
            if isinstance(record, Message):
                run = run or self._rewritten()
                topic = self._topics.get(record.channel_id, "")
                if self._listener is not None:
                    self._listener(topic, record.data, record.log_time)
                if run is not None:
                    run.take(topic, record.data, record.log_time)
            elif isinstance(record, Channel):
                self._topics[record.id] = record.topic
            elif isinstance(record, Metadata):
                run = self._take_story(record)
            elif isinstance(record, DataEnd):
                self._next_file()
                break
        if run is not None:
            run.judge()

    def _take_story(self, record: Metadata) -> GrowingRun | None:
        try:
            if record.name == START_RECORD and self.run is None:
                self.run = GrowingRun(record.metadata)
            elif record.name == END_RECORD and self.run is not None:
                self.run.take_end(record.metadata)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error
        return self.run

    def _rewritten(self) -> GrowingRun | None:
        """Take the story from ``metadata.yaml``: tools that rewrite a bag drop it from where it was, or move it."""
        if self.path.is_dir() and not self._looked_for_story:
            self._looked_for_story = True
            self._story = custom_data(self.path / "metadata.yaml")
            if self._story:
                self.run = GrowingRun(self._story)
        return self.run

    def _next_file(self) -> None:
        self._files.pop(0)
        self._at, self._topics = _MAGIC_SIZE, {}
        self.ended = not self._files
        if self.ended and self.run is not None and not self.run.outcome and "outcome" in self._story:
            self.run.take_end(self._story)


def _whole_records(data: bytes) -> int:
    """Return the size of the records that are there as a whole."""
    at = 0
    while at + _HEAD_SIZE <= len(data):
        end = at + _HEAD_SIZE + int.from_bytes(data[at + 1 : at + _HEAD_SIZE], "little")
        if end > len(data):
            break
        at = end
    return at
