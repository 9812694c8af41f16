"""Force correction: feed the unbalanced force of Eq. 4 back at the next step (Eq. 11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.parameters import check_parameters, parameter


@dataclass(frozen=True)
class ForceCorrectionConfig:
    """How much of the shear is fed back, and how much of the unbalanced force is corrected at once."""

    SECTION: ClassVar[str] = "force_correction"

    gain: float = parameter(
        0.5,
        description="Share of the unbalanced force that is corrected in the next step",
        unit="1",
        source="docs/decisions/0003: 1 is the text of the paper and accumulates noise at the Nyquist frequency",
        lower=0.0,
        upper=1.0,
    )

    feedback_scale: float = parameter(
        1.0,
        description="Share of the interface shear that drives the numerical substructure, in every scheme",
        unit="1",
        source="Chen et al. 2020: 0.3 for the 8-story system; 1 is the whole building",
        lower=0.0,
        lower_open=True,
        upper=1.0,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)


class ForceCorrection:
    """Correct the interface shear by the unbalanced force.

    Parameters
    ----------
    config : ForceCorrectionConfig
        Gain and feedback scale.
    active : bool
        False feeds the scaled shear back without correction (schemes without force correction).

    Notes
    -----
    With the feedback scale s, the numerical substructure feels s f: a specimen with s times its mass, stiffness and
    damping. With the correction force of Eq. 11, f_c = m (ü + ü_g) + c u̇ + k u − s f, the shear fed back is s f − g
    f_c. As the integration balances Eq. 4 exactly, the required force is the shear fed back at the step before, and the
    correction is the filter (1 + g) / (1 + g z⁻¹): unit gain and a lead of g / (1 + g) steps at low frequency, gain (1
    + g) / (1 − g) at the Nyquist frequency.
    """

    def __init__(self, config: ForceCorrectionConfig, active: bool) -> None:
        self._gain = config.gain if active else 0.0
        self._scale = config.feedback_scale

    def reset(self) -> None:
        """Do nothing: the correction has no state of its own."""

    def step(self, required_force: float, interface_force: float) -> float:
        """Return the shear to be fed back.

        Parameters
        ----------
        required_force : float
            m (ü + ü_g) + c u̇ + k u of this step [N].
        interface_force : float
            Shear measured in this step [N].

        Returns
        -------
        float
            s f − g f_c [N].
        """
        shear = self._scale * interface_force
        return shear - self._gain * (required_force - shear)

    def state_space(self) -> DiscreteStateSpace:
        """Return the stage as a linear system, without a state.

        Returns
        -------
        DiscreteStateSpace
            Inputs required force and shear, output shear fed back [N].
        """
        gains = np.array([[-self._gain, (1.0 + self._gain) * self._scale]])
        return DiscreteStateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), gains)
