"""The end of every test: the table is brought to rest and taken out of the hands of the commands."""

from __future__ import annotations

from bmd_rths_core.safety.supervisor import SafetySupervisor
from bmd_rths_core.safety.trips import Action
from bmd_rths_core.table.controller import NoAnswer, TableController


def bring_to_rest(table: TableController, supervisor: SafetySupervisor) -> None:
    """Ramp or brake the table, as the supervisor asks, or to rest when it asks for nothing; then stop it.

    Parameters
    ----------
    table : TableController
        The table. Whatever goes wrong on the way, it is stopped.
    supervisor : SafetySupervisor
        The supervisor of the test that has ended.
    """
    if supervisor.passing:
        supervisor.request(Action.RAMP)
    try:
        while not supervisor.at_rest and (command := supervisor.advance()) is not None:
            try:
                measurement = table.exchange(command)
            except NoAnswer:
                continue
            supervisor.observe(measurement)
    finally:
        halt(table, supervisor)


def halt(table: TableController, supervisor: SafetySupervisor) -> None:
    """Stop the table, by the fastest way it has when an emergency stop was asked for.

    Parameters
    ----------
    table : TableController
        The table.
    supervisor : SafetySupervisor
        The supervisor of the test.
    """
    if supervisor.emergency:
        table.emergency_stop()
    else:
        table.stop()
