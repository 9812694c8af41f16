"""Says what a virtual laboratory assumes; every result from one is shown with it."""

from __future__ import annotations

from bmd_rths_core.config import Config
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig


def assumptions(config: Config, controller: str = "") -> str:
    """Return what the results of a configuration assume that no laboratory has measured.

    Parameters
    ----------
    config : Config
        The whole configuration.
    controller : str
        What really moved the table (`RunRecord.controller`); empty for the one of the configuration.

    Returns
    -------
    str
        One sentence; empty where the table is a real one.
    """
    if (controller or config.table.controller) != "simulated":
        return ""
    table, motion = config.simulated_table, config.ground_motion
    parts = [_dynamics(table)]
    if table.command_delay > 0.0:
        parts.append(f"delay of the command {1e3 * table.command_delay:g} ms")
    if table.specimen_stiffness_factor != 1.0:
        parts.append(f"stories {table.specimen_stiffness_factor:g} times as stiff as their model")
    parts.append(f"accelerometer noise {table.acceleration_noise:g} m/s²")
    if motion.time_scale != 1.0:
        parts.append(f"time of the record multiplied by {motion.time_scale:g}")
    return f"The table is a virtual laboratory; assumed are: {', '.join(parts)}."


def _dynamics(table: SimulatedTableConfig) -> str:
    if table.dynamics == "perfect":
        return "a perfect table"
    if table.dynamics == "sections":
        return "a table with the transfer function simulated_table.sections"
    if table.dynamics == "measured":
        return f"a table fitted to its measured frequency response, within {table.fit_error:.2%}"
    servo = (
        f"a servo table with poles of {table.servo_real_pole:g} and {table.servo_frequency:g} rad/s "
        f"(damping ratio {table.servo_damping_ratio:g})"
    )
    if table.dynamics == "servo":
        return servo
    return f"{servo}, a platen of {table.platen_mass:g} kg that the specimen pulls at"
