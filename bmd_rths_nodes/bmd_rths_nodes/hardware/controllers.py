"""Find the configured table controller: the two of this project, and those that others install."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop import build
from bmd_rths_core.table.controller import TableController
from bmd_rths_nodes.hardware.udp_socket import udp_table

#: Entry points of this group are table controllers: functions of a `Config` that return a `TableController`.
GROUP = "bmd_rths.table_controllers"

Maker = Callable[[Config], TableController]

#: The controllers of this project. Their names cannot be taken by an entry point.
_OWN: dict[str, Maker] = {"simulated": build.make_table_controller, "udp": udp_table}


def make_table_controller(config: Config) -> TableController:
    """Return the table controller of a configuration; nothing is connected yet.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Returns
    -------
    TableController

    Raises
    ------
    InputError
        There is no controller of that name, it cannot be loaded, or it refuses the configuration.
    """
    run, table = config.run, config.table
    if table.controller == "udp" and not run.lockstep and table.answer_timeout >= run.time_step:
        raise InputError(
            f"table.answer_timeout: {table.answer_timeout:g} s is not allowed; "
            f"less than run.time_step, {run.time_step:g} s, is required"
        )
    return make_patient_table_controller(config)


def make_patient_table_controller(config: Config) -> TableController:
    """Return the table controller for a use that closes no loop, where an answer may take longer than Δt.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Raises
    ------
    InputError
        As for `make_table_controller`.
    """
    name = config.table.controller
    maker = _OWN.get(name) or _load(name)
    return maker(config)


def _load(name: str) -> Maker:
    installed: dict[str, EntryPoint] = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in installed:
        known = ", ".join([*_OWN, *sorted(set(installed) - set(_OWN))])
        raise InputError(f"table.controller: {name!r} is not available; one of {known} is required")
    try:
        return installed[name].load()
    except Exception as error:  # the module of a third party may raise anything
        raise InputError(
            f"table.controller: {name!r} ({installed[name].value}) cannot be loaded: {' '.join(str(error).split())}"
        ) from error
