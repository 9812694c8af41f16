"""Time of the paper's campaign, 13 earthquakes with 4 schemes, against real time and two other ways to compute it.

- *this project*: `bmd-rths campaign` as it is used, from the start of the program to its end;
- *stage by stage*: the same runs by `RthsLoop`, one step after the other in NumPy, in one process;
- *scipy*: the assembled linear loop by `scipy.signal.dlsim`, without limits, references and errors, in one process.

The others are timed for some records only (all with --full) and scaled by simulated time. Real records are needed:

    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/campaign.py
    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/campaign.py --full
    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/campaign.py --json

With --list it prints the records as `bmd-rths campaign --motions` takes them. With --memory it measures instead how the
memory of a study of 10,000 runs grows (El Centro, 8 s, 2,500 seeds, two processes); no other record is needed:

    python benchmarks/campaign.py --memory
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from scipy.signal import dlsim

from bmd_rths_core.campaign.motions import CampaignMotion, read_motions
from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.library import read_ground_motion
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.closed_loop import closed_loop
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_nodes.campaign.results import CSV_NAME

CONFIG = Path(__file__).parents[1] / "config" / "simplified_bmd.yaml"
#: One record for every event of the paper, which names no stations: file, component, unit. Chosen before any run.
RECORDS = (
    "Cape_Mendocino/RSN828_CAPEMEND_PET090.AT2",
    "Chi-Chi/RSN1197_CHICHI_CHY028-E.AT2",
    "Christchurch/RSN8123_CCHURCH_REHSN02E.AT2",
    "Chuetsu-oki/RSN4856_CHUETSU_65025EW.AT2",
    "Darfield/RSN6911_DARFIELD_HORCN18E.AT2",
    "El_Centro/RSN6_IMPVALL.I_I-ELC180-hor1.AT2",
    "Kobe/RSN1106_KOBE_KJM000.AT2",
    "Kumamoto/KMMH161604160125.NS2",
    "Montenegro/RSN4457.json,x,g",
    "Morgan_Hill/MorganAccelNoScaling.mat,,m/s2",
    "Northridge/RSN1044_NORTHR_NWH090.AT2",
    "Parkfield/RSN30_PARKF_C05085.AT2",
    "Taipei/TAP017-E.AT2",
)
#: Baseline correction of all of them: the record of Kumamoto drifts out of the stroke as it is.
HIGH_PASS_HZ = 0.1
#: Which of them the others are timed with, and with which scheme.
SAMPLE, SAMPLE_SCHEME = (0, 5, 8), "plc_fc"
REPEATS = 3
#: Shipped record of the study whose memory is measured, and after which share of its runs.
SHIPPED = "el_centro_1940_ns"
MEMORY_SHARES = (0.005, 0.1, 0.25, 0.5, 0.75, 0.98)


def list_of_records() -> str:
    """Return the records as `bmd-rths campaign --motions` takes them."""
    records = os.environ.get("BMD_RTHS_GROUND_MOTIONS")
    if records is None:
        raise click.UsageError("BMD_RTHS_GROUND_MOTIONS: not set; the folder of the real records is required")
    return "".join(f"{Path(records).absolute() / line}\n" for line in RECORDS)


def write_list(folder: Path) -> Path:
    path = folder / "records.csv"
    path.write_text(list_of_records())
    return path


def campaign(motions: Path, output: Path) -> tuple[float, float, list[dict]]:
    """Return wall time, time on the processors, and the runs."""
    command = [sys.executable, "-m", "bmd_rths_nodes.cli.main", "campaign", str(CONFIG), "--json"]
    begin, before = time.perf_counter(), os.times()
    finished = subprocess.run(
        [
            *command,
            *("--set", f"ground_motion.high_pass_frequency={HIGH_PASS_HZ}"),
            *("--motions", str(motions), "--output", str(output)),
        ],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        check=True,
    )
    after = os.times()
    busy = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - begin, busy, json.loads(finished.stdout)["runs"]


def stage_by_stage(config: Config, motion: GroundMotion) -> tuple[float, float, int]:
    """Return wall time, time on the processor, and steps."""
    begin, before = time.perf_counter(), time.process_time()
    record = RthsLoop(config, motion).run()
    return time.perf_counter() - begin, time.process_time() - before, record.steps


def by_scipy(config: Config, motion: GroundMotion) -> tuple[float, float, int]:
    """Return the same of the assembled loop."""
    begin, before = time.perf_counter(), time.process_time()
    loop = closed_loop(config, displacement=True)
    noise = np.random.default_rng(config.run.seed).standard_normal((motion.steps, loop.system.b.shape[1] - 1))
    inputs = np.column_stack((motion.acceleration, noise))
    dlsim((*loop.system, config.run.time_step), inputs, x0=loop.start * motion.acceleration[0])
    return time.perf_counter() - begin, time.process_time() - before, motion.steps


def others(config: Config, motions: Sequence[CampaignMotion], full: bool) -> dict[str, dict[str, float]]:
    """Return seconds per simulated second of the two other ways."""
    cases = [(m, s) for m in motions for s in SCHEME_NAMES] if full else [(motions[i], SAMPLE_SCHEME) for i in SAMPLE]
    result = {}
    for name, run in (("stage by stage", stage_by_stage), ("scipy", by_scipy)):
        timed = []
        for motion, scheme in cases:
            changes = {"ground_motion__record": motion.record, "run__scheme": scheme}
            changes |= {"ground_motion__component": motion.component, "ground_motion__unit": motion.unit}
            changed = config.changed(**changes)
            timed.append(run(changed, select_ground_motion(changed.ground_motion, config.run.time_step)))
        simulated = sum(steps for _, _, steps in timed) * config.run.time_step
        wall, busy = (sum(entry[i] for entry in timed) / simulated for i in (0, 1))
        result[name] = {"wall_per_second": wall, "busy_per_second": busy}
    return result


def resident(process: int) -> int:
    """Return the resident memory of a process [bytes]; 0 when it has ended."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0
    return 1024 * next((int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS:")), 0)


def workers_of(process: int) -> list[int]:
    """Return the processes that a process has started, without the resource tracker."""
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
        return [int(c) for c in children if b"spawn_main" in Path(f"/proc/{c}/cmdline").read_bytes()]
    except OSError:
        return []


def write_shipped(folder: Path) -> Path:
    """Write the shipped record as a file, as the campaign takes it."""
    motion = read_ground_motion(SHIPPED)
    lines = (f"{i * motion.time_step!r},{a!r}\n" for i, a in enumerate(motion.acceleration.tolist()))
    path = folder / f"{SHIPPED}.csv"
    path.write_text("time_s,acceleration_m_s2\n" + "".join(lines))
    return path


def wait_for_results(study: subprocess.Popen[bytes], results: Path, least: float) -> int:
    """Return the number of finished runs once there are so many."""
    while study.poll() is None:
        finished = results.read_bytes().count(b"\n") - 1 if results.exists() else 0
        if finished >= least:
            return finished
        time.sleep(0.1)
    raise click.ClickException(f"the study has ended with status {study.returncode}")


def memory(runs: int) -> list[dict[str, float]]:
    """Return resident memory [MB] of a study at some numbers of finished runs."""
    samples: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        seeds = ",".join(str(seed) for seed in range(runs // len(SCHEME_NAMES)))
        command = [sys.executable, "-m", "bmd_rths_nodes.cli.main", "campaign", str(CONFIG), "--jobs", "2"]
        command += ["--motions", str(write_shipped(Path(folder))), "--set", "ground_motion.duration=8.0"]
        command += ["--vary", f"run.seed={seeds}", "--output", folder]
        study = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        try:
            for share in MEMORY_SHARES:
                finished = wait_for_results(study, Path(folder) / CSV_NAME, share * runs)
                workers = [resident(worker) for worker in workers_of(study.pid)]
                sample = {"study_mb": 1e-6 * resident(study.pid), "largest_worker_mb": 1e-6 * max(workers, default=0)}
                samples.append({"runs": finished, **sample})
        finally:
            study.terminate()
            study.wait()
    return samples


@click.command()
@click.option("--memory", "memory_only", is_flag=True, help="Measure the memory of a study of 10,000 runs instead.")
@click.option("--list", "only_list", is_flag=True, help="Print the records for `bmd-rths campaign --motions` instead.")
@click.option("--runs", default=10000, show_default=True, help="With --memory: size of the study.")
@click.option("--full", is_flag=True, help="Time the others with all 52 runs.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def main(memory_only: bool, only_list: bool, runs: int, full: bool, as_json: bool) -> None:
    """Compare the times, or measure the memory."""
    if only_list:
        print(list_of_records(), end="")
    elif memory_only:
        show_memory(memory(runs), as_json)
    else:
        compare_times(full, as_json)


def show_memory(samples: Sequence[dict[str, float]], as_json: bool) -> None:
    """Print what was measured."""
    if as_json:
        print(json.dumps({"memory": samples}))
        return
    for sample in samples:
        told = f"study {sample['study_mb']:.0f} MB, largest worker {sample['largest_worker_mb']:.0f} MB"
        print(f"after {sample['runs']:.0f} runs: {told}")


def compare_times(full: bool, as_json: bool) -> None:
    """Time the campaign and the two other ways, and print them."""
    config = load_config(CONFIG).changed(ground_motion__high_pass_frequency=HIGH_PASS_HZ)
    with tempfile.TemporaryDirectory() as folder:
        path = write_list(Path(folder))
        motions = read_motions(path).motions
        # Before and after the others, so that a busy minute does not fall on one of them alone.
        timed = [campaign(path, Path(folder) / str(i)) for i in range(REPEATS)]
        rates = others(config, motions, full)
        timed += [campaign(path, Path(folder) / str(REPEATS + i)) for i in range(REPEATS)]
    runs = timed[0][2]
    simulated = sum(run["steps"] for run in runs) * config.run.time_step
    wall, busy = (statistics.median(entry[i] for entry in timed) for i in (0, 1))
    result = {
        "runs": len(runs),
        "simulated_s": simulated,
        "engines": sorted({run["engine"] for run in runs}),
        "wall_s": wall,
        "best_wall_s": min(entry[0] for entry in timed),
        "busy_s": busy,
        "load_average": os.getloadavg()[0],
        "times_faster_than_real_time": simulated / wall,
        "others": {
            name: {
                "wall_s": rate["wall_per_second"] * simulated,
                "wall_ratio": rate["wall_per_second"] * simulated / wall,
                "busy_ratio": rate["busy_per_second"] * simulated / busy,
            }
            for name, rate in rates.items()
        },
    }
    if as_json:
        print(json.dumps(result))
        return
    print(f"{len(runs)} runs, {simulated:.0f} s simulated, load average {result['load_average']:.1f}")
    print(
        f"campaign, whole command: {wall:.2f} s (best {result['best_wall_s']:.2f} s, on the processors {busy:.2f} s):"
        f" {simulated / wall:.0f} times faster than real time"
    )
    for name, other in result["others"].items():
        print(
            f"{name}, one process: {other['wall_s']:.1f} s, x {other['wall_ratio']:.1f};"
            f" time on the processors x {other['busy_ratio']:.1f}"
        )


if __name__ == "__main__":
    main()
