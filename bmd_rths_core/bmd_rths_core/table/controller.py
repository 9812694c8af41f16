"""The small protocol between the table driver and whatever moves the table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

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


class NoAnswer(RuntimeError):
    """The table controller did not answer a step in time: the step has no measurement, and the test goes on."""


class TableController(Protocol):
    """A shake table, simulated or real, with the experimental substructure on it.

    The order of calls is `connect`, then `exchange` once a step, then `stop`, then `close`. `stop`, `emergency_stop`
    and `close` may be called at any time and more than once, and raise nothing; `connect` then begins a new test.

    A controller whose table lives by steps, a model, has an attribute `by_steps` that is true: such a table moves with
    the commands. Without it the table is real: it holds each command until the next one, by the clock.

    A controller that can tell has an attribute `stop_confirmed`: false while the last `stop` or `emergency_stop` was
    not confirmed by the table. A test whose stop is not confirmed has failed.
    """

    def connect(self) -> None:
        """Make the controller ready for step 0, at rest.

        Raises
        ------
        OSError, RuntimeError
            It is not there, or does not want to.
        """

    def exchange(self, command: TableCommand) -> TableMeasurement:
        """Apply a command for one step and return the sensors at its end.

        A command whose step index is more than one ahead of the last one means that commands were lost: the table has
        held the last command in between.

        Parameters
        ----------
        command : TableCommand
            Step index and acceleration command.

        Raises
        ------
        NoAnswer
            The measurement of this step is lost; later steps may have one.
        OSError, RuntimeError
            The table is stopped or in an interlock, or the connection is broken: the test cannot go on.
        """

    def stop(self) -> None:
        """Bring the table to rest in a controlled way; later commands are refused until the next `connect`."""

    def emergency_stop(self) -> None:
        """Bring the table to rest by the fastest way it has; later commands are refused until the next `connect`."""

    def close(self) -> None:
        """Release everything."""

    def statistics(self) -> Mapping[str, str]:
        """Return what the controller can tell about itself and the connection, for the diagnostics."""


@runtime_checkable
class AsynchronousTableController(TableController, Protocol):
    """A table controller that can take a command without waiting for its answer.

    In real time the table driver then calls `begin` once a step and `poll` all the time, instead of `exchange`, and
    goes on with newer commands while an answer is missing. Both are called from one thread.

    A controller that gives up late answers has a method `be_patient()`: it takes them, until the next `connect`. The
    driver calls it on the way to rest, where no loop waits for them, and late ones still tell where the table is.
    """

    @property
    def awaiting(self) -> bool:
        """True while a command is neither answered nor given up."""

    def begin(self, command: TableCommand) -> float | None:
        """Apply a command for one step and return at once.

        Parameters
        ----------
        command : TableCommand
            As for `exchange`.

        Returns
        -------
        float or None
            When the command went out, by the clock of the host [s]; None where the controller cannot tell.

        Raises
        ------
        OSError, RuntimeError
            As for `exchange`.
        """

    def poll(self) -> TableMeasurement | None:
        """Return a measurement that has come, without waiting.

        It may be called at any time, also before `connect` and after `close`, and has nothing to return then. Between
        `connect` and the first command it keeps up the connection.

        Returns
        -------
        TableMeasurement or None
            In the order of the steps. A step whose answer is lost has none.

        Raises
        ------
        OSError, RuntimeError
            As for `exchange`.
        """
