"""Make MPIC, with the options that its settings ask for."""

from __future__ import annotations

from bmd_rths_core.compensators.identified_table import held_table
from bmd_rths_core.compensators.mpic.adaptation import StiffnessControl
from bmd_rths_core.compensators.mpic.config import MpicConfig
from bmd_rths_core.compensators.mpic.control import MpicControl
from bmd_rths_core.compensators.mpic.design import design
from bmd_rths_core.compensators.mpic.stiffness import StiffnessLimits, StoryStiffness
from bmd_rths_core.compensators.mpic.trim import TrimLimits, TrimmedControl
from bmd_rths_core.compensators.protocol import Known
from bmd_rths_core.structure.shear_building import chain_of


def make_control(known: Known) -> MpicControl | StiffnessControl | TrimmedControl:
    """Return MPIC, ready for step 0.

    Parameters
    ----------
    known : Known
        Its settings are an `MpicConfig`.

    Raises
    ------
    InputError
        It cannot be designed, or an option does not fit the time step.
    """
    settings: MpicConfig = known.settings
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
