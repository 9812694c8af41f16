"""Names of recordings."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path


def new_bag_directory(folder: Path, motion: str, scheme: str) -> Path:
    """Return a directory that does not exist yet for the bag of a test.

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
    """
    name = f"{motion}_{scheme}_{datetime.now():%Y%m%d_%H%M%S}"
    candidates = (folder / f"{name}{suffix}" for suffix in ("", *(f"_{i}" for i in range(2, 1000))))
    return next(path for path in candidates if not path.exists())
