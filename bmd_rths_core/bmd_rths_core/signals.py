"""The signals of a step: one table, from which records, topics, bags and the nomenclature derive, or are held to it."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Instant(Enum):
    """The test time that the value of step k belongs to. The message that carries it has the stamp k·Δt either way."""

    BEGIN = "k·Δt"
    END = "(k+1)·Δt"


class Signal(NamedTuple):
    """One signal of every step.

    Parameters
    ----------
    name : str
        Field of `RunRecord`.
    unit : str
        SI unit.
    symbol : str
        As in the paper; "–" where it has none.
    topic : str
        Topic it travels on, relative to the namespace: its own, or the ``measurement`` that carries all sensors.
    instant : Instant
        When it is true.
    per_floor : bool
        One column for every measured floor.
    """

    name: str
    unit: str
    symbol: str
    topic: str
    instant: Instant
    per_floor: bool = False

    @property
    def measured(self) -> bool:
        """True for what the table controller tells, in one message."""
        return self.topic == MEASUREMENT


MEASUREMENT = "measurement"

#: In the order of a step.
SIGNALS = (
    Signal("ground_acceleration", "m/s²", "ü_g, a_g", "ground_acceleration", Instant.BEGIN),
    Signal("desired_acceleration", "m/s²", "ü + ü_g", "desired_acceleration", Instant.BEGIN),
    Signal("required_force", "N", "m (ü + ü_g) + c u̇ + k u", "required_force", Instant.BEGIN),
    Signal("command", "m/s²", "–", "command", Instant.BEGIN),
    Signal("applied_command", "m/s²", "–", MEASUREMENT, Instant.BEGIN),
    Signal("table_acceleration", "m/s²", "ü_m + ü_g", MEASUREMENT, Instant.END),
    Signal("table_displacement", "m", "–", MEASUREMENT, Instant.END),
    Signal("actuator_force", "N", "–", MEASUREMENT, Instant.END),
    Signal("base_shear", "N", "f", MEASUREMENT, Instant.END),
    Signal("floor_accelerations", "m/s²", "aᵢ = üᵢ + ü_g", MEASUREMENT, Instant.END, per_floor=True),
    Signal("interface_force", "N", "f", "interface_force", Instant.END),
    Signal("corrected_force", "N", "f − g f_c", "corrected_force", Instant.END),
)

#: Topics with one number a step, in the order of a step; each has the name of its signal.
SCALAR_TOPICS = tuple(signal.topic for signal in SIGNALS if not signal.measured)
