"""The four compensation schemes of the paper."""

from __future__ import annotations

from enum import Enum


class Scheme(Enum):
    """Compensation scheme: with or without phase-lead compensation and force correction."""

    UC = "uc"
    FC = "fc"
    PLC = "plc"
    PLC_FC = "plc_fc"

    @property
    def phase_lead(self) -> bool:
        """True when the command shaper compensates."""
        return self in (Scheme.PLC, Scheme.PLC_FC)

    @property
    def force_correction(self) -> bool:
        """True when the unbalanced force is corrected."""
        return self in (Scheme.FC, Scheme.PLC_FC)


SCHEME_NAMES = tuple(scheme.value for scheme in Scheme)

#: Names of the schemes whose shaper is the phase lead of `command_shaper`.
PHASE_LEAD = tuple(scheme.value for scheme in Scheme if scheme.phase_lead)
