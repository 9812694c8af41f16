"""Parameters of model-predictive interface control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import POSITIVE_FACTOR, VARIANCE


@dataclass(frozen=True)
class MpicConfig:
    """How much the observer trusts its models, and what the tracking weighs."""

    SECTION: ClassVar[str] = "mpic"

    model_error: float = parameter(
        0.25,
        description="Unmodelled acceleration of every floor the observer assumes with load cells, root mean square, "
        "white over the steps; the larger, the more of a change of the specimen is followed, and of the noise",
        unit="m/s2",
        source="tuned for a capture above 0.95",
        **VARIANCE,
    )
    model_error_accelerometers: float = parameter(
        0.03,
        description="The same without load cells, where the noise of the shear is larger and the model counts for more",
        unit="m/s2",
        source="tuned for the error; the capture is told",
        **VARIANCE,
    )
    command_error: float = parameter(
        0.01,
        description="Error of the command as it acts on the table the observer assumes, root mean square",
        unit="m/s2",
        source="tuned on the simulated table",
        **VARIANCE,
    )
    preview: int = parameter(
        3,
        description="Steps of the ground motion known in advance; the motion of the table starts so much later",
        unit="steps",
        source="docs/decisions: more does not lower the error",
        lower=1,
        upper=100,
    )
    floor_weight: float = parameter(
        0.03,
        description="Weight of the floors of the specimen relative to the interface in the cost of the tracking",
        unit="1",
        source="tuned on the simulated table",
        lower=0.0,
        upper=1e4,
    )
    command_weight: float = parameter(
        1e-3,
        description="Weight of the command relative to the interface in the cost of the tracking",
        unit="1",
        source="tuned on the simulated table",
        **POSITIVE_FACTOR,
    )
    centring_frequency: float = parameter(
        1.5708,
        description="Frequency below which the displacement of the table counts more than its acceleration",
        unit="rad/s",
        source="assumed: 0.25 Hz, well below the first mode",
        lower=1e-3,
        upper=100.0,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)
