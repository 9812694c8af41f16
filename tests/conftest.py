"""What all tests share."""

from __future__ import annotations

import os
from pathlib import Path

# As the programs do, before numpy is imported: on a busy machine the threads of the linear algebra wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: Changes of a configuration: nothing stops the table but a value that is not finite.
WITHOUT_LIMITS = {
    f"safety__{limit}_action": "ignore"
    for limit in ("displacement", "velocity", "acceleration", "force", "increment", "tracking", "stability")
}

#: Changes of a configuration: a servo table for tests whose numbers belong to it, whatever table is the default.
SERVO_TABLE = {
    "simulated_table__dynamics": "servo",
    "simulated_table__servo_real_pole": 49.6,
    "simulated_table__servo_frequency": 183.6,
    "simulated_table__servo_damping_ratio": 0.167,
}


def ground_motion_folder() -> Path:
    """Return where the real records are: they belong to their agencies and are no part of this repository."""
    beside_the_repository = Path(__file__).resolve().parents[2] / "shared" / "ground_motions"
    return Path(os.environ.get("BMD_RTHS_GROUND_MOTIONS", beside_the_repository))
