"""One run on a ROS domain: what DDS finds out within seconds, a file tells other runs of this computer at once."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bmd_rths_core.errors import InputError


@contextmanager
def domain_lock() -> Iterator[bool]:
    """Hold the ROS domain of this process for one run, against other runs of the same user on this computer.

    Yields
    ------
    bool
        False when another run holds it.

    Raises
    ------
    InputError
        The file of the lock cannot be written.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or 0
    path = Path(tempfile.gettempdir()) / f"bmd_rths_{os.getuid()}_run_on_domain_{domain}"
    try:
        file = open(path, "a")  # noqa: SIM115 - closed below; an error of what is done meanwhile is not one of the file
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True
