"""Story shears of the specimen from what its accelerometers say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.config import Config
from bmd_rths_core.record import RunRecord

FloatArray = NDArray[np.float64]


def specimen_story_shears(record: RunRecord, config: Config) -> FloatArray:
    """Return the story shears of the specimen, −Σ mᵢ aᵢ over the floors above each story (Eq. 6).

    Parameters
    ----------
    record : RunRecord
        The run, N steps.
    config : Config
        Its configuration, with the nominal masses of n floors.

    Returns
    -------
    ndarray, shape (N, n)
        From the table up, at the end of each step [N]; positive where a drift to the positive side pulls back. The
        first is the interface shear, with the noise of the sensors.
    """
    inertia = -np.asarray(config.specimen.masses) * record.floor_accelerations
    return np.cumsum(inertia[:, ::-1], axis=1)[:, ::-1]
