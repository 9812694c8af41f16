"""Phase lead (Eq. 10) with weights and lead time found on the identified table."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.identified_table import held_table
from bmd_rths_core.compensators.phase_lead import CommandShaper, CommandShaperConfig, stable_weights, transfer_function
from bmd_rths_core.compensators.protocol import Compensator, Known
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.physical_bounds import POSITIVE_FACTOR

FloatArray = NDArray[np.float64]

#: Frequencies at which the search looks.
_POINTS = 200
#: Weights and lead in steps where it begins.
_W1, _W2, _ALPHA = (1.5, 2.0, 3.0, 5.0, 8.0), (0.0, 0.5, 1.0, 2.0, 3.0), (1.0, 3.0, 5.0, 8.0)
#: Least W1 and W2: the poles of Eq. 10 stay at a modulus of 0.82 and on the left, where they make no resonance.
_LEAST_W1, _LEAST_W2 = 1.5, 0.0


@dataclass(frozen=True)
class TunedPhaseLeadConfig:
    """What the search for weights and lead time weighs."""

    SECTION: ClassVar[str] = "plc_tuned"

    highest_frequency: float = parameter(
        8.0,
        description="Up to here the table is to follow; below half the rate of the loop",
        unit="Hz",
        source="tuned on the simulated table",
        lower=0.1,
        upper=5e3,
    )
    motion_weight: float = parameter(
        0.02,
        description="Weight of what the table makes of commands of all frequencies, relative to its error up to there",
        unit="1",
        source="tuned on the simulated table",
        **POSITIVE_FACTOR,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)


def search(known: Known) -> CommandShaperConfig:
    """Return the weights and the lead time that suit the identified table.

    Parameters
    ----------
    known : Known
        With an identified table; its settings are a `TunedPhaseLeadConfig`.

    Returns
    -------
    CommandShaperConfig

    Raises
    ------
    InputError
        No table was identified, or the highest frequency is above half the rate of the loop.

    Notes
    -----
    Least mean of |1 − C T|² up to the highest frequency plus the weight times the mean of |C T|² up to half the rate, T
    from a command to the table at the begin of the same step. The best of 100 starts is refined by the simplex
    of Nelder and Mead (1965, Comput. J. 7, 308-313). Numerical substructure and share of the shear do not matter: the
    stability analysis varies them for one and the same compensator.
    """
    # scipy.optimize takes half a second to import, which the other schemes need not wait.
    from scipy.optimize import minimize

    settings: TunedPhaseLeadConfig = known.settings
    half = 0.5 / known.time_step
    if not settings.highest_frequency < half:
        raise InputError(
            f"plc_tuned.highest_frequency: {settings.highest_frequency:g} Hz is not allowed; less than half the rate "
            f"of the loop, {half:g} Hz, is required"
        )
    within = np.linspace(settings.highest_frequency / _POINTS, settings.highest_frequency, _POINTS) / half * np.pi
    angles = within, np.linspace(np.pi / _POINTS, np.pi, _POINTS)
    table = held_table(known, "plc_tuned")
    z, responses = [np.exp(1j * at) for at in angles], [table.response(at) for at in angles]

    def cost(values: FloatArray) -> float:
        w1, w2, alpha = values.tolist()
        least = w1 >= _LEAST_W1 and w2 >= _LEAST_W2
        if not least or not stable_weights(w1, w2) or not 0.0 <= alpha * known.time_step <= 10.0:
            return np.inf
        config = CommandShaperConfig(w1, w2, alpha * known.time_step)
        numerator, denominator = transfer_function(config, known.time_step)
        following, everywhere = (
            np.polyval(numerator, at) / np.polyval(denominator, at) * response
            for at, response in zip(z, responses, strict=True)
        )
        missed = np.mean(np.abs(1.0 - following) ** 2)
        return float(missed + settings.motion_weight * np.mean(np.abs(everywhere) ** 2))

    start = min((np.array(values) for values in product(_W1, _W2, _ALPHA)), key=cost)
    found = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-10, "maxiter": 2000})
    w1, w2, alpha = found.x.tolist()
    return CommandShaperConfig(w1, w2, alpha * known.time_step)


def make_tuned_phase_lead(known: Known) -> CommandShaper:
    """Return the phase lead that the search found."""
    return CommandShaper(search(known), known.time_step, active=True)


COMPENSATORS = (
    Compensator(
        "plc_tuned",
        "Phase lead (Eq. 10), weights and lead time from a search on the identified table",
        "The identified table; takes no preview",
        shaper=make_tuned_phase_lead,
        learns=False,
        settings=TunedPhaseLeadConfig,
    ),
)
