"""Model-predictive interface control (MPIC): the hybrid test as tracking of a virtual building that is measured."""

from bmd_rths_core.compensators.mpic.config import MpicConfig
from bmd_rths_core.compensators.mpic.make import make_control
from bmd_rths_core.compensators.protocol import Compensator

COMPENSATORS = (
    Compensator(
        "mpic",
        "Model-predictive interface control: observer, virtual building and linear-quadratic tracking with preview",
        "The identified table and specimen, a linear numerical substructure, table displacement and accelerometers",
        control=make_control,
        settings=MpicConfig,
    ),
)
