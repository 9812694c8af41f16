"""Keep a driven table on the path its commands were to take, where some were held too long."""

from __future__ import annotations

from bmd_rths_core.identification.frequency_response import FloatArray
from bmd_rths_core.safety.commanded_motion import REST, Motion

#: Natural frequency of the critically damped way back [rad/s]: below the band that is identified.
_RETURN = 1.5


class Centring:
    """What is added to commands, so that lost time does not add up to a drift.

    A command of 2 m/s² that a busy computer holds for 0.1 s too long leaves 0.2 m/s, and nothing else takes it away.

    Parameters
    ----------
    commands : ndarray, shape (N,)
        Acceleration commands [m/s²]; none with its addition is larger than the largest of them.
    time_step : float
        Δt [s].
    """

    def __init__(self, commands: FloatArray, time_step: float) -> None:
        self._largest = float(max(abs(commands), default=0.0))
        self._planned = [REST]
        for command in commands.tolist():
            self._planned.append(self._planned[-1].after(command, time_step))

    def corrected(self, step: int, command: float, motion: Motion) -> float:
        """Return the command of a step [m/s²], with what leads the table back.

        Parameters
        ----------
        step : int
            Step index.
        command : float
            As it was planned [m/s²].
        motion : Motion
            Of the table before this command, as far as it is known.
        """
        planned = self._planned[step]
        velocity, displacement = motion.velocity - planned.velocity, motion.displacement - planned.displacement
        wanted = command - 2.0 * _RETURN * velocity - _RETURN**2 * displacement
        return min(max(wanted, -self._largest), self._largest)
