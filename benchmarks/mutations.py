"""Tracebacks in mutated configurations, records, bags and campaign folders, by seed.

Every mutation is given to the reader of its kind, in this process and in its own file. Right are a result or one
`InputError` of one line; anything else is counted, with the seed that makes it again. Run with
``python benchmarks/mutations.py --count 10000 --seed 1``.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import json
import random
import re
import struct
import sys
import tempfile
import time
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import yaml
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from bmd_rths_core.analysis.run_analysis import analysed
from bmd_rths_core.config import Config, dump_config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.catalogue import catalogue
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.formats.stated import Stated
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_nodes.campaign.results import _NUMBERS as NUMBERS
from bmd_rths_nodes.campaign.results import CampaignResults
from bmd_rths_nodes.cli.error_tables import show_error_tables

#: What is put in the place of a number or a word.
_WORDS = ("1e200", "-1e200", "1e-200", "nan", "inf", "-999", "0", "-1", "", "[", "{", "&a [*a]", "'", "\x1b[2J", "=1+1",
          "9" * 400, "true", "null", "x" * 300, "\u2028", "VELOCITY", "UNCORRECTED", "0,5")  # fmt: skip


def mutated(content: bytes, rng: random.Random) -> bytes:
    """Return bytes with one to five changes: bits, pieces cut, moved or doubled, words and numbers replaced."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        if not data:
            break
        begin = rng.randrange(len(data))
        end = min(len(data), begin + rng.choice((1, 1, 4, 40, 400)))
        kind = rng.randrange(7)
        if kind == 0:
            data[begin] = rng.randrange(256)
        elif kind == 1:
            del data[begin:end]
        elif kind == 2:
            data[begin:begin] = data[begin:end]
        elif kind == 3:
            del data[begin:]
        elif kind == 4:
            data[begin:end] = rng.randbytes(end - begin)
        else:
            word = rng.choice(_WORDS).encode()
            stop = begin
            while stop < min(len(data), begin + 30) and chr(data[stop]) not in " ,\n:]":
                stop += 1
            data[begin:stop] = word
    return bytes(data)


def odd(value: Any, rng: random.Random) -> Any:
    """Return a value in the place of another one that a reader may well accept: odd, but of the same kind mostly."""
    if rng.random() < 0.1:
        return rng.choice((None, True, 0, -1, "", "x", [], {}, [[]], [None], float("nan"), float("inf"), 10**30))
    if isinstance(value, bool):
        return not value
    if isinstance(value, (int, float)):
        factors = (0.0, -1.0, 0.5, 2.0, 10.0, 0.1, 1e3, 1e-3, 1e6, 1e-6, 1e12, 1e-12, 1.0 + 1e-9)
        changed = value * rng.choice(factors)
        return int(changed) if isinstance(value, int) and rng.random() < 0.8 else changed
    if isinstance(value, str):
        return rng.choice((value.upper(), value[::-1], value + " ", value[:-1], value + "\u00e9", "none", "all"))
    if isinstance(value, list):
        return rng.choice((value[:-1], value + value, value[::-1], [odd(v, rng) for v in value], value[:1] * 200))
    return value


def with_an_odd_leaf(tree: Any, rng: random.Random) -> Any:
    """Return nested mappings and lists with one value changed, a key renamed, or one left out."""
    if isinstance(tree, dict) and tree:
        key = rng.choice(list(tree))
        if rng.random() < 0.05:
            return {k: v for k, v in tree.items() if k != key}
        if rng.random() < 0.02:
            return {(f"{k}_" if k == key else k): v for k, v in tree.items()}
        return {**tree, key: with_an_odd_leaf(tree[key], rng)}
    if isinstance(tree, list) and tree and rng.random() < 0.7:
        index = rng.randrange(len(tree))
        return [with_an_odd_leaf(v, rng) if i == index else v for i, v in enumerate(tree)]
    return odd(tree, rng)


_NUMBER = re.compile(rb"[-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?")


def mutated_text(content: bytes, rng: random.Random) -> bytes:
    """Return text with whole lines or numbers changed, so that its structure stays."""
    lines = content.split(b"\n")
    for _ in range(rng.choice((1, 1, 2, 4))):
        index = rng.randrange(min(len(lines), rng.choice((8, len(lines)))))
        kind, line = rng.randrange(7), lines[index]
        if kind == 0:
            del lines[index]
        elif kind == 1:
            lines.insert(index, line)
        elif kind == 2:
            other = rng.randrange(len(lines))
            lines[index], lines[other] = lines[other], line
        elif kind == 3:
            lines[index] = line.replace(b",", b";") if b"," in line else line.replace(b" ", b"  ")
        else:
            found = list(_NUMBER.finditer(line))
            if found:
                number = rng.choice(found)
                new = repr(odd(float(number[0]), rng)).encode()
                lines[index] = line[: number.start()] + new + line[number.end() :]
        lines = lines or [b""]
    return b"\n".join(lines)


def mutated_inside(content: bytes, rng: random.Random) -> bytes:
    """Return a file with a change inside, behind what its structure or checksums would refuse at once."""
    if content[:4] == b"PK\x03\x04":
        out = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(out, "w", rng.choice((0, 8))) as new:
            for name in old.namelist():
                member = mutated_text(old.read(name), rng) if rng.random() < 0.7 else mutated(old.read(name), rng)
                for _ in range(rng.choice((1, 1, 1, 2))):
                    new.writestr(rng.choice((name, "../" + name, name.lower(), "b/" + name, name + ".zip")), member)
        return out.getvalue()
    if content[:6] == b"MATLAB":
        data = bytearray(content)
        for _ in range(rng.choice((1, 1, 2, 3))):  # tags are words of four bytes: their low ones matter most
            data[rng.randrange(128, len(data))] = rng.choice((0, 1, 2, 6, 9, 14, 15, 127, 255, rng.randrange(256)))
        return bytes(data)
    if content[:1] in (b"{", b"["):
        return json.dumps(with_an_odd_leaf(json.loads(content), rng)).encode()
    return mutated_text(content, rng)


def mutated_bag(content: bytes, rng: random.Random) -> bytes:
    """Return an MCAP file, written anew with right checksums, whose story or messages are changed."""
    out = io.BytesIO()
    writer = Writer(out, compression=rng.choice((CompressionType.NONE, CompressionType.ZSTD)))
    writer.start("ros2", "mutations")
    what, ids, schemas = rng.randrange(6), {}, {}
    for record in StreamReader(io.BytesIO(content)).records:
        if isinstance(record, Schema):
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel):
            topic = record.topic + "_" if what == 0 and rng.random() < 0.3 else record.topic
            ids[record.id] = writer.register_channel(topic, record.message_encoding, schemas[record.schema_id])
        elif isinstance(record, Metadata):
            told = dict(record.metadata)
            if what in (1, 2) and told:
                key = rng.choice(list(told))
                try:
                    told[key] = json.dumps(with_an_odd_leaf(json.loads(told[key]), rng))
                except ValueError:
                    told[key] = str(odd(told[key], rng))
            writer.add_metadata(record.name, told)
        elif isinstance(record, Message) and not (what == 3 and rng.random() < 0.2):
            data = bytearray(record.data)
            if what in (4, 5) and rng.random() < 0.05:  # a stamp, a length or a number, as a whole
                at = 4 * rng.randrange(len(data) // 4)
                number = struct.pack("<I", rng.choice((0, 1, 2**31, 2**32 - 1, 5_000_000)))
                data[at : at + 4] = rng.choice((number, struct.pack("<f", 1e30), rng.randbytes(4)))
            writer.add_message(ids[record.channel_id], record.log_time, bytes(data), record.publish_time)
    writer.finish()
    return out.getvalue()


def mutated_cells(content: bytes, rng: random.Random) -> bytes:
    """Return a CSV file with one cell changed, or two swapped."""
    rows = list(csv.reader(io.StringIO(content.decode())))
    row = rng.choice(rows[1:])
    at = rng.randrange(len(row))
    if rng.random() < 0.2:
        other = rng.randrange(len(row))
        row[at], row[other] = row[other], row[at]
    else:
        try:
            row[at] = str(odd(json.loads(row[at]), rng))
        except ValueError:
            row[at] = str(odd(row[at], rng))
    if rng.random() < 0.1:
        rows.append(row)
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue().encode()


def records() -> list[tuple[bytes, str]]:
    """Return small records, one in each kind of format, with the name of a component of each."""
    wave = 0.2 * np.sin(0.1 * np.arange(120))
    rows = "".join(f"{0.005 * i:.3f},{v:.6f},{-v:.6f}\n" for i, v in enumerate(wave))
    values = "".join(f"{v:14.6E}" + ("\n" if i % 5 == 4 else "") for i, v in enumerate(wave))
    esm = "EVENT_NAME: X\nSAMPLING_INTERVAL_S: 0.005\nNDATA: 120\nSTREAM: HNE\nUNITS: cm/s^2\nDATA_TYPE: ACCELERATION\n"
    mat = io.BytesIO()
    scipy.io.savemat(mat, {"eq": np.vstack([0.005 * np.arange(120), wave]), "dt": 0.005, "c": {"a": 1.0}})
    small = io.BytesIO()
    scipy.io.savemat(small, {"acc": wave, "dt": 0.005}, do_compression=True)
    at2 = f"PEER\nX\nACCELERATION TIME SERIES IN UNITS OF G\nNPTS= 120, DT= .005 SEC\n{values}".encode()
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as stream:
        stream.writestr("a.AT2", at2)
    numbers = rows.replace(",", " ").encode()
    column = "".join(f"{v:.6f}\n" for v in wave)
    return [
        (at2, "only"),
        (at2.decode().encode("utf-16"), "only"),
        (f"time_s,acc_ns_g,acc_ew_g\n{rows}".encode(), "acc_ns"),
        (numbers, "a"),
        ((esm + column).encode(), "only"),
        (json.dumps({"dT": 0.005, "data_x": list(wave), "data_y": list(-wave), "unit": "g"}).encode(), "x"),
        (mat.getvalue(), "eq"),
        (small.getvalue(), "acc"),
        (archive.getvalue(), "only"),
    ]


def bag_files(folder: Path) -> tuple[bytes, bytes]:
    """Return the two files of the bag of a short test."""
    config = Config().changed(ground_motion__duration=0.5)
    written = write_record(
        RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run(), folder / "bag"
    )
    return next(written.glob("*.mcap")).read_bytes(), (written / "metadata.yaml").read_bytes()


def campaign_file(folder: Path) -> bytes:
    """Return the table of a campaign of one run."""
    folder.mkdir()
    table = CampaignResults(folder)
    errors = dict.fromkeys(("substructure", "control_layer", "superstructure"), 1.5)
    row = {"key": "k", "motion": "m", "event": "El Centro", "file": "=f", "component": "-c", "scheme": "uc",
           "variation": {"run.seed": 1}, "stable": True, "stability": "stable", "outcome": "finished", "reason": "",
           "steps": 3, "rmse_percent": errors, "engine": "x", "rmse_true_percent": errors, "verdict": "red",
           "rmse_clean_percent": errors, "noise_floor_percent": errors, "capture": errors,
           "criteria": {"J1": 1.0, "J2": None}, "peak_drifts": [0.01, None], **dict.fromkeys(NUMBERS, 1.0)}  # fmt: skip
    table.append([row])
    table.close()
    return table.path.read_bytes()


def main() -> int:
    """Mutate, read, count; the exit status says whether there was a traceback."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="leave out so many, to go on")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples = records()
        mcap, metadata = bag_files(folder)
        campaign = campaign_file(folder / "campaign")
        config = dump_config(Config()).encode()
        path = folder / "mutated"

        tree = yaml.safe_load(config)
        short = Config().changed(ground_motion__duration=0.1)

        def read_campaign(rng: random.Random) -> None:
            change = mutated if rng.random() < 0.3 else mutated_cells
            (folder / "campaign" / "campaign.csv").write_bytes(change(campaign, rng))
            table = CampaignResults(folder / "campaign")
            try:
                if "k" in table:
                    with contextlib.redirect_stdout(io.StringIO()):
                        show_error_tables([table.read("k")], rng.random() < 0.5, ())
            finally:
                table.close()

        def read_record(rng: random.Random) -> None:
            change = mutated if rng.random() < 0.3 else mutated_inside
            path.write_bytes(change(rng.choice(samples)[0], rng))
            catalogue(path, Stated(time_step=0.005, columns="from_file" if rng.random() < 0.9 else "time,a,b"))

        def run_record(rng: random.Random) -> None:
            content, component = rng.choice(samples)
            path.write_bytes(mutated_inside(content, rng) if rng.random() < 0.9 else content)
            without_unit = component in ("a", "eq", "acc")
            changed = short.changed(
                ground_motion__record=str(path),
                ground_motion__resample=True,
                ground_motion__component=component,
                ground_motion__columns="time,a,b" if component == "a" else "from_file",
                ground_motion__high_pass_frequency=rng.choice((0.0, 0.1)),
                ground_motion__peak_acceleration=rng.choice((0.0, 1.0)),
                ground_motion__record_time_step=0.005 if component == "eq" else 0.0,
                ground_motion__unit="g" if without_unit else "from_file",
                ground_motion__duration=0.0,
            )
            select_ground_motion(changed.ground_motion, changed.run.time_step)

        def read_mutated_bag(rng: random.Random) -> None:
            bag = folder / "mutated_bag"
            bag.mkdir(exist_ok=True)
            both = rng.random() < 0.3
            (bag / "x_0.mcap").write_bytes(mutated(mcap, rng) if rng.random() < 0.3 else mutated_bag(mcap, rng))
            (bag / "metadata.yaml").write_bytes(mutated(metadata, rng) if both else metadata)
            analysed(read_bag(bag), False)

        def read_config(rng: random.Random) -> None:
            path.write_bytes(mutated(config, rng))
            load_config(path)

        def run_config(rng: random.Random) -> None:
            changed = tree
            for _ in range(rng.choice((1, 1, 2, 3))):
                changed = with_an_odd_leaf(changed, rng)
            path.write_text(yaml.safe_dump(changed))
            loaded = load_config(path).changed(
                table__controller="simulated",
                ground_motion__duration=0.1,
                ground_motion__free_vibration=0.0,
                ground_motion__resample=True,
            )
            ground = select_ground_motion(loaded.ground_motion, loaded.run.time_step)
            analysed(RthsLoop(loaded, ground).run(), False)

        kinds: tuple[Callable[[random.Random], None], ...] = (
            *(read_config, read_record, read_mutated_bag, read_campaign),
            *(run_config, run_record, read_mutated_bag, read_record),
        )
        counts: Counter[str] = Counter()
        slowest = (0.0, 0, "")
        for number in range(options.first, options.first + options.count):
            seed = options.seed * 1_000_003 + number
            kind = kinds[number % len(kinds)]
            begin = time.perf_counter()
            try:
                kind(random.Random(seed))
                counts[f"{kind.__name__}: read"] += 1
            except InputError as error:
                one_line = len(str(error).splitlines()) == 1
                counts[f"{kind.__name__}: {'refused' if one_line else 'REFUSED IN SEVERAL LINES'}"] += 1
                if not one_line:
                    print(f"seed {seed} {kind.__name__}: {str(error)[:200]!r}")
            except Exception as error:
                counts[f"{kind.__name__}: TRACEBACK"] += 1
                print(f"seed {seed} {kind.__name__}: {type(error).__name__}: {str(error)[:200]}")
            slowest = max(slowest, (time.perf_counter() - begin, seed, kind.__name__))
    for what, count in sorted(counts.items()):
        print(f"{what}: {count}")
    print(f"slowest: {slowest[0]:.2f} s, seed {slowest[1]}, {slowest[2]}")
    return int(any(what.endswith(("TRACEBACK", "LINES")) for what in counts))


if __name__ == "__main__":
    sys.exit(main())
