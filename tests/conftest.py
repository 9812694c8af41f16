"""What all tests share."""

from __future__ import annotations

import os
from pathlib import Path

#: Changes of a configuration: nothing stops the table but a value that is not finite.
WITHOUT_LIMITS = {
    f"safety__{limit}_action": "ignore"
    for limit in ("displacement", "velocity", "acceleration", "force", "increment", "tracking", "stability")
}


def ground_motion_folder() -> Path:
    """Return where the real records are: they belong to their agencies and are no part of this repository."""
    beside_the_repository = Path(__file__).resolve().parents[2] / "shared" / "ground_motions"
    return Path(os.environ.get("BMD_RTHS_GROUND_MOTIONS", beside_the_repository))
