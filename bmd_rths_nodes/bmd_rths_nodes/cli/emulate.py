"""``bmd-rths emulate``: a virtual table controller on UDP."""

from __future__ import annotations

import json
import signal
from functools import partial
from typing import TYPE_CHECKING

import click

from bmd_rths_core.errors import InputError
from bmd_rths_core.table.emulated.fault_kinds import KINDS
from bmd_rths_nodes.cli.configuration import ConfigChoice, configured
from bmd_rths_nodes.cli.options import json_option, log

if TYPE_CHECKING:
    from bmd_rths_core.config import Config
    from bmd_rths_nodes.hardware.emulator import Emulator

_FAULTS = "; ".join(f"{name}{f' [{unit}]' if unit else ''}: {meaning}" for name, (meaning, unit, _, _) in KINDS.items())


@click.command(epilog="Example: bmd-rths emulate config/simplified_bmd.yaml --fault loss=5 --fault valve=20@2000")
@configured()
@click.option("--plant", type=click.Choice(("servo", "servo_hydraulic")), help="Model of the table.")
@click.option(
    "--listen",
    metavar="udp://HOST:PORT",
    help="Address to listen on; that of the configuration by default. Port 0 is any free one.",
)
@click.option("--fault", "faults", multiple=True, metavar="NAME[=VALUE][@STEP]", help=f"May be repeated. {_FAULTS}.")
@json_option
def emulate(
    choice: ConfigChoice,
    plant: str | None,
    listen: str | None,
    faults: tuple[str, ...],
    as_json: bool,
) -> int:
    """Be a table controller with a table and the specimen on it, for tests without a laboratory.

    Listens on table.address until Ctrl-C, in real time or in lockstep as the host wants, and prints its statistics at
    the end. With --json the first line on standard output is one object with the port, when it is ready. Faults can be
    changed at run time on the control port.
    """
    from bmd_rths_core.table.wire import Interlock, interlock_names
    from bmd_rths_nodes.hardware.time_slice import shorten_time_slices

    resolved = choice.resolve()
    if plant is not None:
        resolved = resolved.changed(virtual_controller__model=plant)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: ended.append(received))
    emulator = make_emulator(resolved, listen or resolved.table.address, faults)
    ready = {"port": emulator.port, "control_port": emulator.control_port, "model": resolved.virtual_controller.model}
    if as_json:
        click.echo(json.dumps(ready))
    log(", ".join(f"{name} {value}" for name, value in ready.items()))
    shorten_time_slices(resolved.real_time.time_slice)
    emulator.run(lambda: bool(ended))
    told = emulator.statistics()
    told["interlock"] = interlock_names(Interlock(told["interlock"])) if told["interlock"] else "none"
    log(", ".join(f"{name} {value}" for name, value in told.items()))
    return 0


def make_emulator(config: Config, address: str, faults: tuple[str, ...] = ()) -> Emulator:
    """Return the emulator of a configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    address : str
        ``udp://HOST:PORT``; port 0 is any free one.
    faults : tuple of str
        As `parse_fault` takes them.

    Raises
    ------
    InputError
        A fault or the address is wrong, or cannot be used.
    """
    from bmd_rths_core.loop.build import make_virtual_controller
    from bmd_rths_core.table.config import parse_address
    from bmd_rths_core.table.emulated.faults import Faults, parse_fault
    from bmd_rths_nodes.hardware.emulator import Emulator

    parse = partial(parse_fault, model=config.virtual_controller.model, floors=len(config.specimen.masses))
    active = Faults(parse(text) for text in faults)
    host, port = parse_address("--listen", address, any_port=True)
    try:
        return Emulator(make_virtual_controller(config, active), active, parse, config.run.seed, (host, port))
    except OSError as error:
        raise InputError(f"{address}: cannot be used: {error.strerror or error}") from error
