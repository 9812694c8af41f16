"""Safety: what may reach the table, how it is brought to rest, and when a test is about to diverge."""

from bmd_rths_core.safety.config import SafetyConfig
from bmd_rths_core.safety.stability_indicator import StabilityIndicator
from bmd_rths_core.safety.stability_indicator_array import StabilityIndicatorArray
from bmd_rths_core.safety.state import State
from bmd_rths_core.safety.supervisor import SafetySupervisor
from bmd_rths_core.safety.trips import Action, Trip

__all__ = [
    "Action",
    "SafetyConfig",
    "SafetySupervisor",
    "StabilityIndicator",
    "StabilityIndicatorArray",
    "State",
    "Trip",
]
