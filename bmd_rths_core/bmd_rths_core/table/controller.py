"""The small protocol between the table driver and whatever moves the table."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class TableCommand(NamedTuple):
    """What the table is asked to do during one step.

    Parameters
    ----------
    step : int
        Step index k.
    acceleration : float
        Absolute acceleration, held over the step [m/s²].
    """

    step: int
    acceleration: float


class TableMeasurement(NamedTuple):
    """What the sensors say at the end of one step. A value that is not measured is NaN.

    Parameters
    ----------
    step : int
        Step index k of the command that was held until now.
    applied_command : float
        Acceleration command that was really applied [m/s²].
    table_displacement : float
        Displacement of the table [m].
    table_acceleration : float
        Absolute acceleration of the table [m/s²].
    actuator_force : float
        Force of the actuator on the table [N].
    base_shear : float
        Interface shear from load cells below the experimental substructure, with the sign of Eq. 6 [N].
    floor_accelerations : ndarray, shape (n,)
        Absolute accelerations of the floors of the experimental substructure, from the bottom up [m/s²].
    """

    step: int
    applied_command: float
    table_displacement: float
    table_acceleration: float
    actuator_force: float
    base_shear: float
    floor_accelerations: NDArray[np.float64]


class TableController(Protocol):
    """A shake table, simulated or real, with the experimental substructure on it.

    The order of calls is `connect`, then `exchange` once a step, then `stop`, then `close`. `stop` and `close` may be
    called at any time and more than once.
    """

    def connect(self) -> None:
        """Make the controller ready for step 0, at rest."""

    def exchange(self, command: TableCommand) -> TableMeasurement:
        """Apply a command for one step and return the sensors at its end.

        A command whose step index is more than one ahead of the last one means that commands were lost: the table has
        held the last command in between.

        Parameters
        ----------
        command : TableCommand
            Step index and acceleration command.
        """

    def stop(self) -> None:
        """Bring the table to rest; later commands are refused until the next `connect`."""

    def close(self) -> None:
        """Release everything."""
