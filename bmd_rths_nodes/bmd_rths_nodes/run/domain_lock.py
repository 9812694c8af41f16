"""One run in a namespace of a ROS domain.

What DDS finds out within seconds, a file tells other runs of this computer at once.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bmd_rths_core.errors import InputError


def another_run(who: str) -> InputError:
    """Return the refusal of a second run on a domain.

    Parameters
    ----------
    who : str
        What was found of the other one.
    """
    return InputError(
        f"another run is active on this ROS domain ({who}); end it, or set ROS_DOMAIN_ID to a free domain, or give one "
        "of them a --namespace of its own"
    )


@contextmanager
def domain_lock(namespace: str) -> Iterator[None]:
    """Hold a namespace in the ROS domain of this process for one run, against others of this user on this computer.

    Parameters
    ----------
    namespace : str
        For example ``"/rths"``.

    Raises
    ------
    InputError
        Another run holds it, or the file of the lock cannot be written.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or 0
    path = Path(tempfile.gettempdir()) / f"bmd_rths_{os.getuid()}_run_on_domain_{domain}{namespace.replace('/', '.')}"
    try:
        file = open(path, "a")  # noqa: SIM115 - closed below; an error of what is done meanwhile is not one of the file
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise another_run("bmd-rths on this computer") from None
        yield
