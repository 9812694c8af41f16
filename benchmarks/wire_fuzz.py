"""Fuzz both decoders of the UDP wire format: no exception, and no packet that is not one.

Every datagram is judged by a second description of the format that shares no code with the decoders: a list of
fields and their allowed values. Half of the datagrams are random bytes or cut, lengthened and bit-flipped packets with
their CRC as it comes; the other half get a right CRC, so that the content is what decides. Run it with

    python benchmarks/wire_fuzz.py                   # 1,000,000 datagrams for each decoder
    python benchmarks/wire_fuzz.py --count 20000 --seed 1 --json
"""

from __future__ import annotations

import json
import math
import sys
import time
import zlib

import click
import numpy as np
from rich.progress import Progress

from bmd_rths_core.table.wire import (
    ControllerPacket,
    ControllerState,
    HostPacket,
    Interlock,
    Kind,
    Rejection,
    decode_controller_packet,
    decode_host_packet,
    encode_controller_packet,
    encode_host_packet,
)

FLOORS = 2
SEEDS_HOST = [
    encode_host_packet(HostPacket(kind, 7, int(kind is Kind.ARM), 10**9, -1.25, math.nan, 0.01, 99)) for kind in Kind
]
SEEDS_CONTROLLER = [
    encode_controller_packet(
        ControllerPacket(state, 7, 3, Interlock(16), 5, 0.1, -2.0, 3e4, math.nan, (1.0,) * floors, 99)
    )
    for state in ControllerState
    for floors in (FLOORS, FLOORS, 1, 3)
]


def number(data: bytes, offset: int, length: int) -> int:
    return int.from_bytes(data[offset : offset + length], "little")


def framed(data: bytes, magic: bytes) -> bool:
    return data[:4] == magic and number(data, 4, 2) == 1 and number(data, len(data) - 4, 4) == zlib.crc32(data[:-4])


def is_host_packet(data: bytes) -> bool:
    if len(data) != 56 or not framed(data, b"RTHC"):
        return False
    kind = number(data, 6, 2)
    exponent_of_command = number(data, 24, 8) >> 52 & 0x7FF
    if kind == 2:
        return exponent_of_command != 0x7FF
    return number(data, 12, 4) <= 1 if kind == 1 else kind <= 5


def is_controller_packet(data: bytes) -> bool:
    if len(data) != 72 + 8 * FLOORS or not framed(data, b"RTHM"):
        return False
    return (
        number(data, 6, 2) <= 4
        and number(data, 16, 4) <= 255
        and number(data, 20, 2) == FLOORS
        and number(data, 22, 2) == 0
    )


def mutated(random: np.random.Generator, seeds: list[bytes]) -> bytes:
    way = random.integers(10)
    if way == 0:
        data = bytearray(random.bytes(int(random.integers(0, 120))))
    else:
        data = bytearray(seeds[random.integers(len(seeds))])
        for _ in range(int(random.integers(0, 4))):
            bit = int(random.integers(8 * len(data)))
            data[bit // 8] ^= 1 << bit % 8
        if way == 1:
            del data[int(random.integers(len(data))) :]
        elif way == 2:
            data += random.bytes(int(random.integers(1, 20)))
        elif way == 3:
            offset = int(random.integers(len(data) - 8))
            data[offset : offset + 8] = random.bytes(8)
    if len(data) >= 4 and random.integers(2):
        data[-4:] = zlib.crc32(bytes(data[:-4])).to_bytes(4, "little")
    return bytes(data)


def fuzz(name: str, count: int, seed: int, progress: Progress) -> dict[str, float | int]:
    seeds = SEEDS_HOST if name == "host" else SEEDS_CONTROLLER
    is_packet = is_host_packet if name == "host" else is_controller_packet
    random = np.random.default_rng(seed)
    accepted = wrong = exceptions = 0
    decoding = 0.0
    task = progress.add_task(f"{name} packets", total=count)
    for i in range(count):
        data = mutated(random, seeds)
        begin = time.perf_counter()
        try:
            packet = decode_host_packet(data) if name == "host" else decode_controller_packet(data, FLOORS)
        except Exception:  # any at all is what is looked for
            exceptions += 1
            continue
        finally:
            decoding += time.perf_counter() - begin
        accepted += not isinstance(packet, Rejection)
        wrong += isinstance(packet, Rejection) == is_packet(data)
        if i % 10_000 == 0:
            progress.update(task, completed=i)
    return {
        "datagrams": count,
        "accepted": accepted,
        "wrongly judged": wrong,
        "exceptions": exceptions,
        "decoding [us]": 1e6 * decoding / count,
    }


@click.command()
@click.option("--count", default=1_000_000, help="Datagrams for each decoder.")
@click.option("--seed", default=0, help="Seed of the mutations.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def main(count: int, seed: int, as_json: bool) -> None:
    """Fuzz both decoders; exit status 1 when one of them is wrong."""
    begin = time.perf_counter()
    with Progress(transient=True, disable=not sys.stderr.isatty()) as progress:
        result = {name: fuzz(name, count, seed, progress) for name in ("host", "controller")}
    if as_json:
        print(json.dumps(result))
    else:
        for name, values in result.items():
            print(name, ", ".join(f"{key} {value:.6g}" for key, value in values.items()))
        print(f"{time.perf_counter() - begin:.0f} s")
    sys.exit(any(values["wrongly judged"] or values["exceptions"] for values in result.values()))


if __name__ == "__main__":
    main()
