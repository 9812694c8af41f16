"""The true motion of a virtual table, without noise and faults of the sensors, and its peaks."""

from __future__ import annotations

from typing import NamedTuple


class TrueMotion(NamedTuple):
    """True motion of a table, or its largest absolute values.

    Parameters
    ----------
    displacement : float
        [m].
    velocity : float
        [m/s].
    acceleration : float
        [m/s²].
    force : float
        Force of the actuator [N].
    """

    displacement: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    force: float = 0.0

    def peaks(self, motion: TrueMotion) -> TrueMotion:
        """Return the larger of these peaks and the absolute values of a motion.

        Parameters
        ----------
        motion : TrueMotion
            The motion.
        """
        displacement, velocity, acceleration, force = motion
        return TrueMotion(
            max(self.displacement, abs(displacement)),
            max(self.velocity, abs(velocity)),
            max(self.acceleration, abs(acceleration)),
            max(self.force, abs(force)),
        )
