"""Tracebacks in mutated configurations, records, bags and campaign folders, by seed.

Every mutation is given to the reader of its kind, in this process and in its own file. Right are a result or one
`InputError` of one line; anything else is counted, with the seed that makes it again. Run with
``python benchmarks/mutations.py --count 10000 --seed 1``.
"""

from __future__ import annotations

import argparse
import io
import json
import random
import sys
import tempfile
import time
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.io

from bmd_rths_core.config import Config, dump_config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.catalogue import catalogue
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.formats.stated import Stated
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_nodes.campaign.results import CampaignResults

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


def records() -> list[bytes]:
    """Return small records, one in each kind of format."""
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
    return [
        at2,
        at2.decode().encode("utf-16"),
        f"time_s,acc_ns_g,acc_ew_g\n{rows}".encode(),
        rows.replace(",", " ").encode(),
        (esm + "".join(f"{v:.6f}\n" for v in wave)).encode(),
        json.dumps({"dT": 0.005, "data_x": list(wave), "unit": "g"}).encode(),
        mat.getvalue(),
        small.getvalue(),
        archive.getvalue(),
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
    row = {"key": "k", "motion": "m", "event": "e", "file": "=f", "component": "-c", "scheme": "uc", "variation": {},
           "stable": True, "outcome": "finished", "reason": "", "steps": 3, "rmse_percent": errors,
           "tracking_delay_ms": 1.0, "engine": "x", "rmse_true_percent": errors, "rmse_clean_percent": errors,
           "noise_floor_percent": errors, "capture": errors, "tracking_error_percent": 1.0, "delay_ms": 1.0,
           "verdict": "red", "spectral_radius": 0.9, "peak_command": 1.0, "peak_displacement": 1.0}  # fmt: skip
    table.append([row])
    table.close()
    return table.path.read_bytes()


def main() -> int:
    """Mutate, read, count; the exit status says whether there was a traceback."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
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

        def read_campaign(rng: random.Random) -> None:
            (folder / "campaign" / "campaign.csv").write_bytes(mutated(campaign, rng))
            table = CampaignResults(folder / "campaign")
            try:
                if "k" in table:
                    table.read("k")
            finally:
                table.close()

        def read_record(rng: random.Random) -> None:
            path.write_bytes(mutated(rng.choice(samples), rng))
            catalogue(path, Stated(time_step=0.005, columns="from_file" if rng.random() < 0.9 else "time,a,b"))

        def read_mutated_bag(rng: random.Random) -> None:
            bag = folder / "mutated_bag"
            bag.mkdir(exist_ok=True)
            both = rng.random() < 0.3
            (bag / "x_0.mcap").write_bytes(mutated(mcap, rng))
            (bag / "metadata.yaml").write_bytes(mutated(metadata, rng) if both else metadata)
            read_bag(bag)

        def read_config(rng: random.Random) -> None:
            path.write_bytes(mutated(config, rng))
            load_config(path)

        kinds: tuple[Callable[[random.Random], None], ...] = (read_config, read_record, read_mutated_bag, read_campaign)
        counts: Counter[str] = Counter()
        slowest = (0.0, 0, "")
        for number in range(options.count):
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
