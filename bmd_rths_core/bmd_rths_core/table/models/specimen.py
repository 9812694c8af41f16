"""Model of the experimental substructure, which stands on the table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.parameters import parameter
from bmd_rths_core.physical_bounds import DAMPING, DAMPING_RATIO, MASS, STIFFNESS
from bmd_rths_core.structure.config import BuildingConfig


@dataclass(frozen=True)
class SpecimenConfig(BuildingConfig):
    """Stories above the interface, from the table up: control layer, then superstructure."""

    SECTION: ClassVar[str] = "specimen"

    masses: tuple[float, ...] = parameter(
        (760.0, 800.0),
        description="Floor masses from the table up: control layer, superstructure",
        unit="kg",
        source="Chen et al. 2020, Table 1",
        **MASS,
    )
    stiffnesses: tuple[float, ...] = parameter(
        (2495320.0, 4941700.0),
        description="Story stiffnesses from the table up",
        unit="N/m",
        source="Chen et al. 2020, Table 1",
        **STIFFNESS,
    )
    damping_coefficients: tuple[float, ...] = parameter(
        (3330.0, 78.0),
        description="Story damping coefficients from the table up",
        unit="N s/m",
        source="Chen et al. 2020, Table 1",
        **DAMPING,
    )

    identified_frequency: float = parameter(
        37.31,
        description="Identified natural frequency of the first mode, for stability analyses with one mode; "
        "0 takes that of the stories, which is the default for every other specimen than that of the paper",
        unit="rad/s",
        source="Chen et al. 2020: 5.94 Hz",
        lower=0.0,
        upper=100000.0,
    )
    identified_damping_ratio: float = parameter(
        0.0214,
        description="Identified damping ratio of the first mode, for stability analyses with one mode; "
        "0 takes that of the stories, which is the default for every other specimen than that of the paper",
        unit="1",
        source="Chen et al. 2020: 2.14 %",
        **DAMPING_RATIO,
    )
