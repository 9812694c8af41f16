"""What a driven simulated table answers, without driving it step by step: for tests of what is made of the answers."""

from __future__ import annotations

import numpy as np

from bmd_rths_core.config import Config
from bmd_rths_core.identification.excited_table import Responses
from bmd_rths_core.identification.frequency_response import FloatArray
from bmd_rths_core.integration.linear_simulation import LinearSimulation
from bmd_rths_core.table.models.sensors import noise_streams
from bmd_rths_core.table.models.simulated import SimulatedTable


def simulated_responses(config: Config, command: FloatArray) -> Responses:
    """Return what `drive` returns of the simulated table of a configuration, but for rounding.

    Parameters
    ----------
    config : Config
        The whole configuration; nothing is quantised and no limit is passed.
    command : ndarray, shape (N,)
        Acceleration commands [m/s²].
    """
    settings, step, seed = config.simulated_table, config.run.time_step, config.run.seed
    table = SimulatedTable(settings, config.specimen.building(), step, seed).state_space(displacement=True)
    simulation = LinearSimulation(table, np.zeros((len(table.a), 1)))
    accelerations, shear, displacement, _ = np.split(simulation.advance(command[:, None])[0].T, [-3, -2, -1], axis=1)
    noise, drive_noise = noise_streams(seed)
    of_sensors = noise.standard_normal((len(command), accelerations.shape[1] + 1))
    of_drives = drive_noise.standard_normal((len(command), 2))
    accelerations = accelerations + settings.acceleration_noise * of_sensors[:, :-1]
    return Responses(
        time_step=step,
        command=command,
        table=accelerations[:, 0],
        floors=accelerations[:, 1:],
        source="simulated",
        displacement=displacement[:, 0] + settings.displacement_noise * of_drives[:, 0],
        shear=shear[:, 0] + settings.shear_noise * of_sensors[:, -1],
    )
