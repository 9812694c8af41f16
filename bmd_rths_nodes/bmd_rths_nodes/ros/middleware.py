"""Settings of the middleware for every process of this project: a tool that comes or goes never costs a step.

Status that was lost is sent again within a twentieth of a second, so that the last words of a node can be waited for.

The shared memory of Fast DDS may hold a publisher up for a third of a second when a process comes or goes. Without it
there is nothing to wait for, but with the discovery range LOCALHOST rmw_fastrtps adds it whatever the transports are
said to be. So that range is put into a profile, as rmw_fastrtps means it, with UDP only (docs/decisions/0004).
"""

from __future__ import annotations

import hashlib
import os
import socket
import sys
import tempfile
from collections.abc import Sequence
from html import escape
from pathlib import Path

from bmd_rths_core.errors import InputError

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"

#: A file of this name in the current folder is a profile too, unless SKIP_DEFAULT_XML_FILE is 1.
PROFILES_IN_FOLDER = "DEFAULT_FASTRTPS_PROFILES.xml"

#: Discovery ranges in which the nodes of a test find each other.
ALLOWED_RANGES = ("SUBNET", "LOCALHOST", "SYSTEM_DEFAULT")

#: Names of transports without shared memory.
_WITHOUT_SHARED_MEMORY = ("UDPv4", "UDPv6", "NONE")

#: As many processes of a computer are looked for as rmw_fastrtps looks for with LOCALHOST.
_PARTICIPANTS = 32

_PROFILES = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
{participant}  <data_writer profile_name="/diagnostics">
    <!-- Acknowledgements are asked for every 3 s else, and what was lost is not sent again before. -->
    <times><heartbeatPeriod><sec>0</sec><nanosec>50000000</nanosec></heartbeatPeriod></times>
  </data_writer>
</profiles>
"""
_PARTICIPANT = """  <transport_descriptors>
    <transport_descriptor>
      <transport_id>bmd_rths_udp</transport_id>
      <type>UDPv4</type>
      <maxInitialPeersRange>{participants}</maxInitialPeersRange>
    </transport_descriptor>
  </transport_descriptors>
  <participant profile_name="bmd_rths" is_default_profile="true">
    <rtps>
      <builtin>
        <!-- A unicast locator, so that there is no multicast. -->
        <metatrafficUnicastLocatorList><locator><udpv4/></locator></metatrafficUnicastLocatorList>
        <initialPeersList>{peers}</initialPeersList>
      </builtin>
      <userTransports><transport_id>bmd_rths_udp</transport_id></userTransports>
      <useBuiltinTransports>false</useBuiltinTransports>
    </rtps>
  </participant>
"""
_PEER = "<locator><udpv4><address>{}</address></udpv4></locator>"


def prepare_middleware() -> None:
    """Set the environment of this process, and of those it starts, before rclpy is initialised.

    Another middleware or a profile that a person has chosen is left as it is, and standard error says so.

    Raises
    ------
    InputError
        The discovery range is one in which no test is possible, or a static peer is unknown.
    """
    scope, peers = _discovery()
    middleware = os.environ.get("RMW_IMPLEMENTATION", "")
    if middleware and not middleware.startswith("rmw_fastrtps"):
        _tell(f"RMW_IMPLEMENTATION is {middleware}: what ros2 tools cost a test was measured with rmw_fastrtps_cpp")
        return
    profile = os.environ.get(PROFILES, "")
    if not profile and os.environ.get("SKIP_DEFAULT_XML_FILE") != "1" and Path(PROFILES_IN_FOLDER).is_file():
        profile = str(Path(PROFILES_IN_FOLDER).absolute())
    transports = os.environ.setdefault(TRANSPORTS, "UDPv4")
    if profile and not _is_ours(profile):
        adds = f", and {RANGE}=LOCALHOST adds shared memory to it" if scope == "LOCALHOST" else ""
        _tell(f"the profile {profile} is used as it is{adds}; with shared memory, a ros2 tool can end a test")
    elif scope == "LOCALHOST":
        participant = _PARTICIPANT.format(participants=_PARTICIPANTS, peers=_locators(peers))
        os.environ[PROFILES] = str(_written(_PROFILES.format(participant=participant)))
        os.environ[RANGE] = "SYSTEM_DEFAULT"
        os.environ.pop("ROS_LOCALHOST_ONLY", None)
    elif not profile:
        os.environ[PROFILES] = str(_written(_PROFILES.format(participant="")))
        if transports.partition("?")[0] not in _WITHOUT_SHARED_MEMORY:
            _tell(f"{TRANSPORTS} is {transports}, which has shared memory: a ros2 tool can end a test; UDPv4 has none")


def _discovery() -> tuple[str, Sequence[str]]:
    """Return the discovery range a person has chosen, and the other computers."""
    if os.environ.get("ROS_LOCALHOST_ONLY") == "1":
        return "LOCALHOST", ()
    scope = os.environ.get(RANGE) or "SUBNET"
    if scope not in ALLOWED_RANGES:
        reason = "with which nodes do not find each other" if scope == "OFF" else "which is not known"
        raise InputError(f"{RANGE}: {scope}, {reason}; allowed are {', '.join(ALLOWED_RANGES)}")
    return scope, [peer for peer in os.environ.get("ROS_STATIC_PEERS", "").split(";") if peer]


def _locators(peers: Sequence[str]) -> str:
    """Return this computer and others as a list of locators."""
    addresses = []
    for peer in peers:
        try:
            addresses.append(socket.gethostbyname(peer))
        except OSError as error:
            raise InputError(f"ROS_STATIC_PEERS: {peer!r} is not a computer that is known: {error.strerror}") from error
    return "".join(_PEER.format(escape(address)) for address in ("127.0.0.1", *addresses))


def _tell(text: str) -> None:
    print(f"middleware: {text}", file=sys.stderr, flush=True)


def _prefix() -> str:
    return f"bmd_rths_{os.getuid()}_fastdds_"


def _is_ours(profile: str) -> bool:
    return Path(profile).name.startswith(_prefix())


def _written(text: str) -> Path:
    """Write a profile for this and other processes of the same settings, and return its file."""
    name = f"{_prefix()}{hashlib.sha256(text.encode()).hexdigest()[:12]}.xml"
    path = Path(tempfile.gettempdir()) / name
    try:
        descriptor, scratch = tempfile.mkstemp(prefix=name, dir=path.parent)
        with open(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
        os.replace(scratch, path)  # whole at any time: another process may read it just now
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    return path
