"""Make MPIC, with the options that its settings ask for."""

from __future__ import annotations

import numpy as np

from bmd_rths_core.compensators.identified_table import held_table
from bmd_rths_core.compensators.mpic.adaptation import StiffnessControl
from bmd_rths_core.compensators.mpic.config import MpicConfig
from bmd_rths_core.compensators.mpic.control import MpicControl
from bmd_rths_core.compensators.mpic.design import design
from bmd_rths_core.compensators.mpic.stiffness import StiffnessLimits, StoryStiffness
from bmd_rths_core.compensators.mpic.trim import TrimLimits, TrimmedControl
from bmd_rths_core.compensators.protocol import Known
from bmd_rths_core.errors import InputError
from bmd_rths_core.structure.shear_building import chain_of

#: Where the table is examined, over the frequency of the centring: far below what was identified.
_SLOW = np.geomspace(1e-3, 1.0, 31)


def make_control(known: Known) -> MpicControl | StiffnessControl | TrimmedControl:
    """Return MPIC, ready for step 0.

    Parameters
    ----------
    known : Known
        Its settings are an `MpicConfig`.

    Raises
    ------
    InputError
        It cannot be designed, an option does not fit the time step, or the identified table answers slow commands the
        wrong way.
    """
    settings: MpicConfig = known.settings
    _refuse_reversed(known, settings.centring_frequency)
    plain = MpicControl(design(known), known.specimen.stories, known.load_cell)
    control: MpicControl | StiffnessControl = plain
    if settings.stiffness:
        stiffness = StiffnessLimits(
            settings.stiffness_lower_frequency,
            settings.stiffness_upper_frequency,
            settings.stiffness_memory,
            settings.stiffness_least,
            settings.stiffness_largest,
            settings.stiffness_rate,
        )
        chain = chain_of(known.specimen, "mpic.stiffness")
        found = StoryStiffness(chain, known.noise, known.load_cell, stiffness, known.time_step)
        control = StiffnessControl(plain, known, found)
    if not settings.trim:
        return control
    limits = TrimLimits(
        settings.trim_memory,
        settings.trim_quiet_acceleration,
        settings.trim_largest_gain,
        settings.trim_largest_delay,
        settings.trim_gain_rate,
        settings.trim_delay_rate,
    )
    return TrimmedControl(control, held_table(known, "mpic"), limits, known.time_step)


def _refuse_reversed(known: Known, centring: float) -> None:
    """Refuse a table that is centred against its command: a slow zero on the right leads it out of the stroke."""
    if known.table is None:  # the design says so
        return
    a, b = known.table.a[:-2, :-2], known.table.b[:-2, 0]
    row, through, identity = known.table.output[0, :-2], known.table.feedthrough[0], np.eye(len(a))
    for frequency in centring * _SLOW:
        response = row @ np.linalg.solve(1j * frequency * identity - a, b) + through
        if response.real <= 0.0:
            raise InputError(
                f"identified_model: the table moves against its command at {frequency / (2.0 * np.pi):.2g} Hz, where "
                f"scheme mpic centres it (mpic.centring_frequency {centring:g} rad/s); an identification that does not "
                "guess below its band is required"
            )
