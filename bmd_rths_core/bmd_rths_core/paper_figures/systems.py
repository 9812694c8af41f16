"""The two systems of the paper, and which of its figures belong to them."""

from __future__ import annotations

from typing import NamedTuple

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.stability.models import EQUATION_9


class PaperSystem(NamedTuple):
    """A system of Chen et al. (2020).

    Parameters
    ----------
    name : str
        As the paper calls it.
    frequency : float
        ω_N, first natural frequency of the numerical substructure [rad/s].
    figures : tuple of int
        Figures of the paper that are about it.
    """

    name: str
    frequency: float
    figures: tuple[int, ...]


EIGHT_STORY = PaperSystem("8-story BMD", 35.43, (6, 7, 8))
SIMPLIFIED = PaperSystem("simplified BMD", 94.09, (10, 11, 13))

#: All figures that can be drawn.
FIGURES = (*EIGHT_STORY.figures, *SIMPLIFIED.figures)

#: The stated values are marked at the paper's ω_N, so a configuration has to have it.
_TOLERANCE = 0.005


def system_of(config: Config) -> PaperSystem:
    """Return the system of the paper that a configuration describes, by its ω_N.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Returns
    -------
    PaperSystem

    Raises
    ------
    InputError
        It is neither of the two.
    """
    frequency = float(config.numerical_substructure.building().modes().frequencies[0])
    for system in (EIGHT_STORY, SIMPLIFIED):
        if abs(frequency - system.frequency) <= _TOLERANCE * system.frequency:
            return system
    allowed = " or ".join(f"{s.frequency:g} rad/s ({s.name})" for s in (EIGHT_STORY, SIMPLIFIED))
    raise InputError(
        f"numerical_substructure: first natural frequency {frequency:.4g} rad/s is that of no system of the paper; "
        f"{allowed} is required"
    )


def table_name(config: Config) -> str:
    """Return what the simulated table of a configuration is called in a figure.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Returns
    -------
    str
        For example ``"Eq. 9"``.
    """
    table = config.simulated_table
    if table.dynamics == "servo":
        name = "third-order servo"
    elif table.dynamics == "interacting_servo":
        name = "third-order servo with interaction"
    elif table.dynamics == "perfect":
        name = "perfect table"
    else:
        name = "Eq. 9" if table.sections == EQUATION_9 else "configured sections"
    return name if table.command_delay == 0.0 else f"{name} + {1e3 * table.command_delay:g} ms"
