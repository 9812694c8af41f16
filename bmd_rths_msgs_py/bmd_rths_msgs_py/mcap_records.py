"""Records of an MCAP file, as far as it is whole."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import IO

from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk

from bmd_rths_core.errors import InputError

#: Largest record of an MCAP file, and largest chunk behind its compression [bytes].
MAX_RECORD = 256_000_000


def open_regular(path: Path) -> IO[bytes]:
    """Open a file to be read; what is no regular file may never end.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        It is a device, a pipe or a folder.
    """
    if path.exists() and not path.is_file():
        raise InputError(f"{path.name!r} is no regular file; an MCAP file is required")
    return path.open("rb")


def records_until_damage(stream: IO[bytes], whole_file: bool = True) -> Iterator[McapRecord]:
    """Yield the records of an MCAP file up to the first that is incomplete or fails its checksum.

    Only one chunk is in memory at a time.

    Parameters
    ----------
    stream : IO of bytes
        The file.
    whole_file : bool
        False for records out of the middle of a file, which has its mark at its beginning only.
    """
    reader = StreamReader(
        stream, skip_magic=not whole_file, validate_crcs=True, emit_chunks=True, record_size_limit=MAX_RECORD
    )
    records = reader.records
    while True:
        try:
            record = next(records)
            inner = _inner(record) if isinstance(record, Chunk) else [record]
        except Exception:  # whatever mcap, struct, the text codec or a decompressor make of damaged bytes
            return
        yield from inner


def _inner(chunk: Chunk) -> list[McapRecord]:
    if chunk.uncompressed_size > MAX_RECORD:
        raise ValueError("a chunk larger than any that is written")
    return list(breakup_chunk(chunk, validate_crc=True))
