"""Return to rest of an acceleration-controlled table, without an offset of velocity or displacement."""

from __future__ import annotations

import math

#: The table counts as at rest when it is asked for less than this [m, m/s].
DISPLACEMENT_TOLERANCE, VELOCITY_TOLERANCE = 1e-5, 1e-4


def at_rest(displacement: float, velocity: float) -> bool:
    """Tell whether nothing is left of a motion.

    Parameters
    ----------
    displacement, velocity : float
        What the table is asked to have [m, m/s].
    """
    return abs(displacement) < DISPLACEMENT_TOLERANCE and abs(velocity) < VELOCITY_TOLERANCE


def return_acceleration(displacement: float, velocity: float, frequency: float, duration: float) -> float:
    """Return the acceleration that leads back to rest, by the free motion of a critically damped oscillator.

    Asked for again after each hold, it ends displacement and velocity at zero together, without passing zero if the
    table does not already move towards it fast.

    Parameters
    ----------
    displacement, velocity : float
        What the table is asked to have now [m, m/s].
    frequency : float
        ω of the oscillator [rad/s].
    duration : float
        How long the acceleration is held [s].

    Returns
    -------
    float
        Mean of the acceleration of that motion over the hold [m/s²], so that the velocity after it is exact.
    """
    # x(t) = (x + (v + ω x) t) e^−ωt, so v(t) = (v − ω (v + ω x) t) e^−ωt.
    rise = frequency * (velocity + frequency * displacement)
    end = (velocity - rise * duration) * math.exp(-frequency * duration)
    return (end - velocity) / duration
