"""Names of recordings."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from bmd_rths_core.errors import InputError


def new_bag_directory(folder: Path, motion: str, scheme: str) -> Path:
    """Make a new, empty directory for the bag of a test.

    Parameters
    ----------
    folder : Path
        Where recordings go.
    motion, scheme : str
        Names of ground motion and compensation scheme.

    Returns
    -------
    Path
        ``<motion>_<scheme>_<date>_<time>`` in the folder, with a number when two tests start in one second.

    Raises
    ------
    InputError
        It cannot be made.
    """
    name = f"{motion}_{scheme}_{datetime.now():%Y%m%d_%H%M%S}"
    for suffix in ("", *(f"_{i}" for i in range(2, 1000))):
        directory = folder / f"{name}{suffix}"
        try:
            directory.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
        return directory
    raise InputError(f"{folder}: a thousand recordings {name} are there; another folder is required")
