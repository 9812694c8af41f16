"""The schemes of the paper: phase lead (Eq. 10) by the compensator of Chen and Tsai (2013), and force correction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bmd_rths_core.compensators.protocol import Compensator, Known
from bmd_rths_core.compensators.schemes import Scheme
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import FACTOR
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import exact_steps


@dataclass(frozen=True)
class CommandShaperConfig:
    """Weights and lead time of the phase-lead compensator."""

    SECTION: ClassVar[str] = "command_shaper"

    w1: float = parameter(2.0, description="Weight W1 of Eq. 10", unit="1", source="Chen et al. 2020, W1 = 2", **FACTOR)
    w2: float = parameter(2.0, description="Weight W2 of Eq. 10", unit="1", source="Chen et al. 2020, W2 = 2", **FACTOR)
    lead_time: float = parameter(
        0.025,
        description="Delay of the table that is made up for; in time steps it is the delay constant alpha of Eq. 10",
        unit="s",
        source="Chen et al. 2020: 25 ms, alpha = 5 at 200 Hz",
        lower=0.0,
        upper=10.0,
    )

    def __post_init__(self) -> None:
        """Check the values and that the weights lie in the stable region."""
        check_parameters(self)
        if not stable_weights(self.w1, self.w2):
            raise InputError(
                f"command_shaper.w1, command_shaper.w2: W1 = {self.w1:g}, W2 = {self.w2:g} put a pole of the phase-lead"
                " compensator on or outside the unit circle; |W1| > 1 and |W2| < |W1 + 1| are required"
            )


def stable_weights(w1: float, w2: float) -> bool:
    """Tell whether Eq. 10 is a stable compensator with these weights.

    Parameters
    ----------
    w1, w2 : float
        Weights W1 and W2.

    Returns
    -------
    bool
        True when both poles lie strictly inside the unit circle.

    Notes
    -----
    The poles are the roots of z² + (W2/W1) z + 1/W1. By the criterion of Jury, both roots of z² + p z + q lie inside
    the unit circle if and only if |q| < 1 and |p| < 1 + q. With q = 1/W1 the first says |W1| > 1. Then 1 + q > 0, and
    multiplied by |W1| the second says |W2| < |W1| (1 + 1/W1) = |W1 + 1|.
    """
    return abs(w1) > 1.0 and abs(w2) < abs(w1 + 1.0)


class CommandShaper:
    """Turn the desired acceleration into the acceleration command of the table.

    Parameters
    ----------
    config : CommandShaperConfig
        Weights and lead time.
    time_step : float
        Δt [s].
    active : bool
        False passes the desired acceleration on unchanged (schemes without phase-lead compensation).
    """

    def __init__(self, config: CommandShaperConfig, time_step: float, active: bool) -> None:
        self._active = active
        numerator, denominator = transfer_function(config, time_step)
        w1 = denominator[0]
        self._b0, self._b1, self._b2 = (b / w1 for b in numerator)
        self._a1, self._a2 = denominator[1] / w1, denominator[2] / w1
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._z1 = 0.0
        self._z2 = 0.0

    def step(self, desired_acceleration: float) -> float:
        """Return the command of this step.

        Parameters
        ----------
        desired_acceleration : float
            Absolute interface acceleration [m/s²].

        Returns
        -------
        float
            Acceleration command [m/s²].
        """
        if not self._active:
            return desired_acceleration
        command = self._b0 * desired_acceleration + self._z1
        self._z1 = self._b1 * desired_acceleration - self._a1 * command + self._z2
        self._z2 = self._b2 * desired_acceleration - self._a2 * command
        return command

    def learn(self, measurement: TableMeasurement) -> None:
        """Do without: the lead is constant."""

    def state_space(self) -> DiscreteStateSpace:
        """Return the stage as a linear system.

        Returns
        -------
        DiscreteStateSpace
            Input desired acceleration, output command [m/s²].
        """
        if not self._active:
            return DiscreteStateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
        return DiscreteStateSpace(
            a=np.array([[-self._a1, 1.0], [-self._a2, 0.0]]),
            b=np.array([[self._b1 - self._a1 * self._b0], [self._b2 - self._a2 * self._b0]]),
            c=np.array([[1.0, 0.0]]),
            d=np.array([[self._b0]]),
        )


def transfer_function(
    config: CommandShaperConfig, time_step: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the coefficients of Eq. 10 in descending powers of z.

    Parameters
    ----------
    config : CommandShaperConfig
        Weights and lead time.
    time_step : float
        Δt [s].

    Returns
    -------
    numerator, denominator : tuple of three floats
    """
    w1, w2 = config.w1, config.w2
    alpha = exact_steps(config.lead_time, time_step)  # 5, not nearly 5, for the 25 ms of the paper
    lead = (w1 + w2 + 1.0) * alpha
    return (w1 + lead, w2 - lead, 1.0), (w1, w2, 1.0)


def _phase_lead(known: Known) -> CommandShaper:
    return CommandShaper(known.settings, known.time_step, active=True)


def _no_lead(known: Known) -> CommandShaper:
    return CommandShaper(known.settings, known.time_step, active=False)


_SUMMARIES = {
    Scheme.UC: "No compensation: the table gets the desired acceleration",
    Scheme.FC: "Force correction alone",
    Scheme.PLC: "Phase-lead compensation (Eq. 10)",
    Scheme.PLC_FC: "Phase-lead compensation and force correction",
}

COMPENSATORS = tuple(
    Compensator(
        scheme.value,
        summary,
        needs="The delay of the table, command_shaper.lead_time" if scheme.phase_lead else "Nothing",
        shaper=_phase_lead if scheme.phase_lead else _no_lead,
        force_correction=scheme.force_correction,
        learns=False,
        settings=CommandShaperConfig,
    )
    for scheme, summary in _SUMMARIES.items()
)
