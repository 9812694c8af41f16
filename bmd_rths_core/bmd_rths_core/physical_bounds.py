"""Bounds of parameters: what can be built, with room on both sides.

Numbers beyond them are a mistaken unit or a slip of the keyboard, and what is computed from them overflows, does not
fit into memory or never ends. They are wide on purpose: a bound is no recommendation. Where a
source is named the bound lies a factor of ten or more beyond it; everything else is assumed.

- masses and stiffnesses: assumed; from a bench-top model of 0.1 kg on a ruler (1 N/m) to a story of a tall building,
  1e7 kg on 1e11 N/m, with a factor of ten; dampings, weights, lengths and drifts are those of such stories;
- shake tables: the largest is E-Defense, 1 m, 2 m/s, 9 m/s² (15 m/s² upwards) with 1.2e6 kg (Horiuchi et al. 2022,
  J. Disaster Res. 17, 985-999); small electric ones are assumed to reach 100 m/s² with a thrust of 50 N;
- hydraulics: oil of 7e8 to 2e9 Pa, supplies of 7 to 35 MPa, valves of 10 to 300 Hz (Merritt 1967, Hydraulic Control
  Systems);
- natural frequencies: beyond `LARGEST_FREQUENCY` the exact integration of a story loses more than 1e-4 to rounding
  (measured: 6 % at 1e6 rad/s, in proportion to the square);
- noises, variances, factors, coefficients, ramps and limits: assumed; beyond them sums of squares overflow, or a test
  would take minutes to begin or to end.
"""

from __future__ import annotations

from typing import TypedDict


class Bounds(TypedDict):
    """Lower and upper bound, as `parameters.parameter` takes them."""

    lower: float
    upper: float


#: Largest √(4 k/m) and c/m of a story [rad/s].
LARGEST_FREQUENCY = 3e4

MASS = Bounds(lower=0.1, upper=1e8)  # kg
ADDED_MASS = Bounds(lower=0.0, upper=1e12)  # kg; a table that nothing pulls at has no end of it
STIFFNESS = Bounds(lower=1.0, upper=1e12)  # N/m
DAMPING = Bounds(lower=0.0, upper=1e10)  # N s/m
DAMPING_RATIO = Bounds(lower=0.0, upper=10.0)
WEIGHT = Bounds(lower=0.0, upper=1e10)  # N
LENGTH = Bounds(lower=1e-3, upper=1e3)  # m
DRIFT = Bounds(lower=1e-7, upper=10.0)  # m
POLE = Bounds(lower=0.1, upper=1e5)  # rad/s
POLE_DAMPING = Bounds(lower=1e-3, upper=10.0)
DISPLACEMENT = Bounds(lower=1e-4, upper=100.0)  # m
SPEED = Bounds(lower=1e-3, upper=1e3)  # m/s
ACCELERATION = Bounds(lower=1e-3, upper=1e5)  # m/s²
FORCE = Bounds(lower=1.0, upper=1e10)  # N
FORCE_NOISE = Bounds(lower=0.0, upper=1e9)  # N
NOISE = Bounds(lower=0.0, upper=1e3)  # m/s²
DISPLACEMENT_NOISE = Bounds(lower=0.0, upper=1.0)  # m
VARIANCE = Bounds(lower=1e-9, upper=1e3)  # m/s²
DISPLACEMENT_VARIANCE = Bounds(lower=1e-9, upper=1.0)  # m
FORCE_VARIANCE = Bounds(lower=1e-6, upper=1e9)  # N
FACTOR = Bounds(lower=-1e4, upper=1e4)
POSITIVE_FACTOR = Bounds(lower=1e-6, upper=1e4)
COEFFICIENT = Bounds(lower=-1e20, upper=1e20)

#: Slower than this a table would take minutes to come to rest.
RAMP_ACCELERATION = Bounds(lower=0.01, upper=1e5)  # m/s²
RAMP_JERK = Bounds(lower=0.1, upper=1e9)  # m/s³

#: Limits of the safety supervisor, some of which are set so low that they trip, or so high that they never do.
LIMITS_BY_UNIT = {
    "m": DISPLACEMENT,
    "m/s": SPEED,
    "m/s2": Bounds(lower=1e-9, upper=1e6),
    "m/s3": Bounds(lower=1e-9, upper=1e9),
    "N": Bounds(lower=1e-3, upper=1e10),
    "s": Bounds(lower=1e-4, upper=1e3),
    "rad/s": Bounds(lower=1e-3, upper=1e3),
    "1": Bounds(lower=1e-6, upper=1e12),
}
