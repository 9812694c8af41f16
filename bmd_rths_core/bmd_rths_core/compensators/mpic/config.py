"""Parameters of model-predictive interface control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import POSITIVE_FACTOR, VARIANCE, Bounds

_TIME = Bounds(lower=0.01, upper=600.0)


@dataclass(frozen=True)
class MpicConfig:
    """How much the observer trusts its models, and what the tracking weighs."""

    SECTION: ClassVar[str] = "mpic"

    model_error: float = parameter(
        0.35,
        description="Unmodelled acceleration of every floor the observer assumes with load cells, root mean square, "
        "white over the steps; the larger, the more of a change of the specimen is followed, and of the noise",
        unit="m/s2",
        source="tuned for a capture above 0.95 with every record, docs/reference/compensators.md",
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
    observer: str = parameter(
        "joint",
        description="What corrects the virtual building: joint, one observer of table and specimen; uncertain_table, "
        "another such observer that assumes table_error; or measured_table, an observer of the specimen that the "
        "measured motion of the table drives. The last two are for a table that is not known well",
        source="docs/reference/compensators.md",
        choices=("joint", "uncertain_table", "measured_table"),
    )
    table_error: float = parameter(
        0.3,
        description="Error of the command as it acts on the table that the observer uncertain_table assumes, root mean "
        "square",
        unit="m/s2",
        source="tuned on simulated tables within 10 % of the identified one",
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
    stiffness: bool = parameter(
        False, description="Find the stiffness of every story while the test runs, and design again for it"
    )
    stiffness_lower_frequency: float = parameter(
        3.0,
        description="Lower end of the band in which drifts and shears are compared, about the first modes",
        unit="Hz",
        source="tuned on the simulated table",
        lower=0.01,
        upper=1e3,
    )
    stiffness_upper_frequency: float = parameter(
        10.0,
        description="Upper end of that band; below half the rate of the loop",
        unit="Hz",
        source="tuned on the simulated table",
        lower=0.01,
        upper=1e3,
    )
    stiffness_memory: float = parameter(
        3.0, description="Time in which the past is forgotten", unit="s", source="tuned on the simulated table", **_TIME
    )
    stiffness_least: float = parameter(
        0.6,
        description="Least stiffness of a story over the identified one",
        unit="1",
        source="assumed",
        lower=0.05,
        upper=1.0,
    )
    stiffness_largest: float = parameter(
        1.3, description="Largest stiffness of the same", unit="1", source="assumed", lower=1.0, upper=20.0
    )
    stiffness_rate: float = parameter(
        0.25, description="Largest rate of the same", unit="1/s", source="assumed", lower=0.0, upper=10.0
    )
    trim: bool = parameter(
        False, description="Find gain and delay of the table while the test runs, and trim the command for them"
    )
    trim_memory: float = parameter(
        4.0, description="Time in which the trim forgets", unit="s", source="tuned on the simulated table", **_TIME
    )
    trim_quiet_acceleration: float = parameter(
        0.1,
        description="Motion of the table in 1 to 8 Hz, root mean square, below which the trim does not move",
        unit="m/s2",
        source="assumed: twice the noise of an accelerometer",
        lower=0.0,
        upper=1e3,
    )
    trim_largest_gain: float = parameter(
        1.3,
        description="Largest gain of the table that is trimmed; the least is its inverse",
        unit="1",
        source="assumed",
        lower=1.0,
        upper=3.0,
    )
    trim_largest_delay: float = parameter(
        0.008,
        description="Largest delay of the table that is trimmed, of either sign",
        unit="s",
        source="assumed",
        lower=0.0,
        upper=0.1,
    )
    trim_gain_rate: float = parameter(
        0.1, description="Largest rate of the gain", unit="1/s", source="assumed", lower=0.0, upper=10.0
    )
    trim_delay_rate: float = parameter(
        0.003, description="Largest rate of the delay", unit="s/s", source="assumed", lower=0.0, upper=1.0
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
