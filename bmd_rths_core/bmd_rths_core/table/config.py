"""Which table controller the table driver talks to, and where it is."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter

_ADDRESS = re.compile(r"udp://(?P<host>[A-Za-z0-9._-]+):(?P<port>[0-9]{1,5})", re.ASCII)


#: Largest `TableConfig.answer_timeout` [s].
LONGEST_ANSWER_TIMEOUT = 0.1


@dataclass(frozen=True)
class TableConfig:
    """The table controller, and the connection to it when it is not simulated in process."""

    SECTION: ClassVar[str] = "table"

    controller: str = parameter(
        "simulated", description="Table controller: simulated, udp, or the name of one that is installed"
    )
    address: str = parameter("udp://127.0.0.1:50600", description="Where the udp controller is, udp://HOST:PORT")
    local_address: str = parameter(
        "udp://127.0.0.1:0",
        description="Address of this computer the udp controller answers to; the default is heard on this computer "
        "only, port 0 is any free one",
    )
    answer_timeout: float = parameter(
        0.0,
        description="Longest wait for the answer to a command in real time, less than the time step; the step then has "
        "no measurement. 0 is until the next command is due",
        unit="s",
        source="the deadline of a step",
        lower=0.0,
        upper=LONGEST_ANSWER_TIMEOUT,
    )
    resend_after: float = parameter(
        0.02,
        description="Wait for an answer after which the same packet is sent again, except commands in real time",
        unit="s",
        lower=0.001,
        upper=1.0,
    )
    give_up_after: float = parameter(
        1.5,
        description="Silence after which the controller counts as not there",
        unit="s",
        source="longer than the 1 s after which a controller lets go of a host that has died",
        lower=0.01,
        upper=4.0,
    )
    stop_timeout: float = parameter(
        3.0, description="Longest wait for the table to come to rest after a stop", unit="s", lower=0.01, upper=60.0
    )
    reset_interlock: bool = parameter(
        False, description="Reset an interlock of the controller when connecting, instead of refusing to start"
    )

    send_displacement: bool = parameter(
        False,
        description="The udp controller gets velocity and displacement with every acceleration, for a table that is "
        "displacement-controlled",
    )

    @property
    def halt_time(self) -> float:
        """Longest time until a stop of the controller is confirmed, or given up [s]; 0 for the simulated table."""
        return 0.0 if self.controller == "simulated" else self.stop_timeout + 2.0 * self.give_up_after

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)
        if not self.controller:
            raise InputError("table.controller: empty; the name of a table controller is required")
        parse_address("table.address", self.address)
        parse_address("table.local_address", self.local_address, any_port=True)


def parse_address(name: str, address: str, any_port: bool = False) -> tuple[str, int]:
    """Return host and port of an address.

    Parameters
    ----------
    name : str
        Parameter or option, for the message.
    address : str
        ``udp://HOST:PORT``.
    any_port : bool
        Port 0 is allowed.

    Returns
    -------
    host : str
    port : int

    Raises
    ------
    InputError
        It is no such address.
    """
    match = _ADDRESS.fullmatch(address)
    lowest = 0 if any_port else 1
    if match is None or not lowest <= int(match["port"]) <= 65535:
        raise InputError(
            f"{name}: {address!r} is not allowed; udp://HOST:PORT with a port {lowest} to 65535 is required"
        )
    return match["host"], int(match["port"])
