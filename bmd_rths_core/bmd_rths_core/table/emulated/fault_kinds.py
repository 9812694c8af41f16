"""The faults that can be asked for: a table without numbers of its own, so that help texts need no numpy."""

from __future__ import annotations

#: What a fault of each name means, its unit, the largest value and the value it has when none is given.
KINDS: dict[str, tuple[str, str, float, float]] = {
    "loss": ("packets that are lost", "%", 100.0, 10.0),
    "delay": ("delay of every packet", "ms", 10_000.0, 5.0),
    "jitter": ("largest random delay of a packet", "ms", 10_000.0, 2.0),
    "duplicates": ("packets that come twice", "%", 100.0, 10.0),
    "reordering": ("packets that are held back until later ones have passed", "%", 100.0, 10.0),
    "bit_flips": ("packets with a wrong bit", "%", 100.0, 10.0),
    "stuck": ("sensor that keeps its value: acceleration, displacement, force, shear, floor_1 ...", "", 0.0, 4.0),
    "nan": ("sensor that gives NaN: one of those", "", 0.0, 4.0),
    "frozen": ("controller answers, but does nothing any more", "", 0.0, 0.0),
    "dead": ("controller does not answer any more", "", 0.0, 0.0),
    "valve": ("opening the servovalve still reaches", "%", 100.0, 10.0),
    "pressure": ("supply pressure that is left", "%", 100.0, 0.0),
}

#: Sensors in the order of the value of "stuck" and "nan"; floor i comes at 3 + i.
SENSORS = ("acceleration", "displacement", "force", "shear")
