"""Keep a file for one process, on every platform."""

from __future__ import annotations

import sys
from typing import BinaryIO

if sys.platform == "win32":
    import msvcrt

    #: The byte that is locked: Windows keeps others from reading what is locked, so it lies far behind the content.
    _FAR_BEHIND = 2**40

    def lock(file: BinaryIO) -> None:
        """Lock an open file until it is closed; raise `BlockingIOError` when another process has it."""
        place = file.tell()
        file.seek(_FAR_BEHIND)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError as error:
            raise BlockingIOError(*error.args) from error
        finally:
            file.seek(place)

else:
    import fcntl

    def lock(file: BinaryIO) -> None:
        """Lock an open file until it is closed; raise `BlockingIOError` when another process has it."""
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
