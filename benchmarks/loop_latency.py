"""Closure time of a step: the product in four modes, and the floor, the same ring over UDP without ROS.

See README.md beside this file for how to run it and how to read it.
"""

from __future__ import annotations

import contextlib
import gc
import json
import math
import multiprocessing
import os
import platform
import select
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np

from bmd_rths_core.config import Config, load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.ground_motion.library import read_ground_motion
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.ground_motion.processing import scale_time
from bmd_rths_core.loop import build
from bmd_rths_core.loop.conductor import Begun, Conductor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_msgs_py import topics
from bmd_rths_msgs_py.cdr import MeasurementCodec, ScalarCodec

CONFIG = Path(__file__).parents[1] / "config" / "simplified_bmd.yaml"

#: End of a wait that is spent looking at the clock [s]; that of `bmd_rths_nodes.ros.spin`, not imported for its rclpy.
WAKE_UP_MARGIN = 0.0003

#: Without a message for this long the ring is broken, and whoever waits gives up [s].
TIMEOUT = 5.0

#: So that a slow host does not end a test before its steps are counted.
PATIENT = {"run.longest_miss_time": 10.0, "safety.stale_shear_time": 10.0}

#: Mode: what it is called, options of ``bmd-rths run`` (None for the UDP ring), and the floor it is compared with.
MODES: dict[str, tuple[str, tuple[str, ...] | None, str]] = {
    "five_paced": ("five processes, paced", (), "udp_paced"),
    "five_free": ("five processes, free-running", ("--lockstep",), "udp_free"),
    "composed_paced": ("composed, paced", ("--composed",), "udp_paced"),
    "composed_free": ("composed, free-running", ("--composed", "--lockstep"), "udp_free"),
    "udp_paced": ("floor: UDP ring, paced", None, "udp_paced"),
    "udp_free": ("floor: UDP ring, free-running", None, "udp_free"),
}


def product_run(settings: list[str], options: tuple[str, ...]) -> dict[str, Any]:
    """Run ``bmd-rths run`` once and return what its JSON tells about timing."""
    domain = str(1 + os.getpid() % 100)
    environment = {**os.environ, "ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with tempfile.TemporaryDirectory(prefix="loop_latency_") as folder:
        arguments = ["run", str(CONFIG), "--json", "--output", f"{folder}/bags", *settings, *options]
        command = [sys.executable, "-m", "bmd_rths_nodes.cli.main", *arguments]
        answer, messages = Path(folder, "stdout"), Path(folder, "stderr")
        with open(answer, "wb") as out, open(messages, "wb") as err:
            # In a session of its own: Ctrl-C is for this process, which then ends the run in order.
            process = subprocess.Popen(command, stdout=out, stderr=err, env=environment, start_new_session=True)
            try:
                process.wait()
            except BaseException:
                process.send_signal(signal.SIGINT)  # it ends its nodes, and itself at the latest after 15 s
                process.wait()
                raise
        try:
            result = json.loads(answer.read_text())
        except ValueError:
            raise click.ClickException(f"bmd-rths {' '.join(arguments)}: {messages.read_text()}") from None
    return {key: result[key] for key in ("closure_ms", "missed_deadlines", "steps", "outcome")}


# ---- the floor: one process a stage, a pair of connected UDP sockets a topic

#: What travels in the ring; the ground acceleration is for a recorder only, and the ring has none.
TOPICS = (*(topic for topic in topics.SCALAR_TOPICS if topic is not topics.GROUND_ACCELERATION), topics.MEASUREMENT)

#: The roles in the other four processes; the numerical substructure runs in this one.
ROLES = (topics.COMMAND_SHAPER, topics.TABLE_DRIVER, topics.SHEAR_ESTIMATOR, topics.FORCE_CORRECTION)


def codec_of(topic: topics.Topic, config: Config) -> Any:
    if topic is topics.MEASUREMENT:
        return MeasurementCodec(len(config.specimen.masses), config.run.stamps, topic.frame_id)
    return ScalarCodec(topic.frame_id)


def make_step(role: str, config: Config) -> Callable[..., Any]:
    """Return what a role does with the step index and the values of its topics."""
    if role == topics.TABLE_DRIVER:
        measured: list[TableMeasurement] = []
        supervisor, table = build.make_supervisor(config), build.make_table_controller(config)
        driver = TableDriver(table, supervisor, config.run.time_step, lockstep=True, on_measurement=measured.append)
        driver.arm()

        def exchange(step: int, command: float) -> Any:
            driver.command(step, command, 0.0)
            if not measured:
                raise RuntimeError(driver.reason)
            return measured.pop()

        return exchange
    stage = getattr(build, f"make_{role}")(config)
    return lambda _, *values: stage.step(*values)


def run_stage(role: str, config: Config, channels: dict[str, tuple[socket.socket, socket.socket]], ready: Any) -> None:
    """Run a stage until this process is terminated, or has heard nothing for `TIMEOUT`."""
    step, step_of = make_step(role, config), config.run.stamps.step_under_way
    sources = [(channels[t.name][0], codec_of(t, config).unpack) for t in TOPICS if role in t.consumers]
    output = next(topic for topic in TOPICS if topic.producer == role)
    send, pack = channels[output.name][1].send, codec_of(output, config).pack
    for reader, _ in sources:
        reader.settimeout(TIMEOUT)
    gc.collect()
    gc.freeze()
    ready.wait()
    with contextlib.suppress(TimeoutError):
        while True:
            received = [unpack(reader.recv(4096)) for reader, unpack in sources]
            stamp = received[-1][0]
            send(pack(stamp, step(step_of(stamp), *[value for _, value in received])))


@contextlib.contextmanager
def ring(config: Config) -> Iterator[dict[str, tuple[socket.socket, socket.socket]]]:
    """Start the four other stages, give the reading and the writing end of every topic, and leave nothing behind."""
    context = multiprocessing.get_context("spawn")
    ready = context.Barrier(len(ROLES) + 1)
    with contextlib.ExitStack() as stack:
        channels = {}
        for topic in TOPICS:
            reader, writer = (stack.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in range(2))
            reader.bind(("127.0.0.1", 0))
            writer.connect(reader.getsockname())
            channels[topic.name] = (reader, writer)
        for role in ROLES:
            process = context.Process(target=run_stage, args=(role, config, channels, ready), daemon=True)
            # Ctrl-C is for this process; a blocked signal stays blocked in a child, and is only deferred here.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            process.start()
            stack.callback(process.join)
            stack.callback(process.terminate)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        ready.wait(60.0)
        yield channels


def udp_run(config: Config, motion: GroundMotion, expected: np.ndarray, lockstep: bool) -> dict[str, Any]:
    """Run the ring once, the conductor in this process; the result must be that of `RthsLoop`."""
    clock, stamps = time.perf_counter, config.run.stamps
    corrected = np.full(motion.steps, np.nan)
    unpack = codec_of(topics.CORRECTED_FORCE, config).unpack
    pack_desired = codec_of(topics.DESIRED_ACCELERATION, config).pack
    pack_required = codec_of(topics.REQUIRED_FORCE, config).pack
    with ring(config) as channels:
        reader = channels[topics.CORRECTED_FORCE.name][0]
        send_desired = channels[topics.DESIRED_ACCELERATION.name][1].send
        send_required = channels[topics.REQUIRED_FORCE.name][1].send

        def on_step(begun: Begun) -> None:
            send_desired(pack_desired(stamps.of(begun.step), begun.desired_acceleration))
            send_required(pack_required(stamps.of(begun.step), begun.required_force))

        conductor = Conductor(
            motion.acceleration.tolist(),
            build.make_numerical_substructure(config),
            build.make_stability_indicator(config),
            config.run.time_step,
            lockstep,
            config.run.longest_miss_time,
            on_step,
        )
        gc.collect()
        gc.freeze()
        while conductor.outcome is None:
            wait = conductor.poll(clock()) - clock() - WAKE_UP_MARGIN
            if select.select([reader], [], [], min(max(0.0, wait), TIMEOUT))[0]:
                stamp, force = unpack(reader.recv(4096))
                corrected[stamps.step_under_way(stamp)] = force
                conductor.shear(stamps.step_under_way(stamp), force, clock())
        gc.unfreeze()
    deadlines, steps = conductor.deadlines, conductor.step
    timing = deadlines.statistics()
    comparable = timing.missed_steps[0] if timing.missed_steps else motion.steps  # then an old shear was held
    assert np.array_equal(corrected[:comparable], expected[:comparable]), "the ring does not compute what RthsLoop does"
    return {
        "closure_ms": dict(timing.closure_ms),
        "missed_deadlines": timing.missed_deadlines,
        "steps": steps,
        "outcome": str(conductor.outcome),
    }


def gaps() -> int:
    """Return how often a busy loop of 2 s was kept from running for more than 1 ms."""
    count, last = 0, time.perf_counter()
    end = last + 2.0
    while last < end:
        now = time.perf_counter()
        count += now - last > 1e-3
        last = now
    return count


def processor_times() -> list[int]:
    """Return user, nice, system, idle, iowait, irq, softirq and steal time; empty where there is no /proc/stat."""
    path = Path("/proc/stat")
    return [int(field) for field in path.read_text().splitlines()[0].split()[1:9]] if path.exists() else []


def steal_percent(before: list[int], after: list[int]) -> float | None:
    """Return the share of the time between two readings that the host gave to others [%]."""
    return 100.0 * (after[7] - before[7]) / (sum(after) - sum(before)) if sum(after) > sum(before) else None


def summary(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return medians over the repeats, and how many deadlines were missed and runs were finished in all of them."""
    medians = {k: statistics.median(run["closure_ms"][k] or math.nan for run in runs) for k in ("p50", "p99", "max")}
    sums = {key: sum(run[key] for run in runs) for key in ("missed_deadlines", "steps")}
    return {**medians, **sums, "finished": sum(run["outcome"] == "finished" for run in runs), "runs": len(runs)}


def show(result: dict[str, Any]) -> None:
    """Print the result for a person."""
    ratios = result["ratios"]
    print(f"{'closure of a step [ms]':<30}{'p50':>8}{'p99':>8}{'max':>8}   {'missed':<18}p50, p99 to the floor")
    for mode, row in result["modes"].items():
        missed = f"{row['missed_deadlines']} of {row['steps']}"
        ratio = "x {p50:.2f}, x {p99:.2f}".format(**ratios[mode])
        note = "" if row["finished"] == row["runs"] else f"   {row['finished']} of {row['runs']} runs finished"
        print(f"{MODES[mode][0]:<30}{row['p50']:8.3f}{row['p99']:8.3f}{row['max']:8.3f}   {missed:<18}{ratio}{note}")
    print("five processes to composed, paced: p50 x {p50:.2f}, p99 x {p99:.2f}".format(**ratios["five_to_composed"]))
    print("machine:", ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in result["machine"].items()))


@click.command(epilog="Example: python benchmarks/loop_latency.py --quick")
@click.option("--steps", type=click.IntRange(100, 100_000), default=10_000, show_default=True, help="Steps of a run.")
@click.option("--repeats", type=click.IntRange(1), default=2, show_default=True, help="Runs of each mode, in turn.")
@click.option("--quick", is_flag=True, help="The same as --steps 1000 --repeats 1.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output.")
def main(steps: int, repeats: int, quick: bool, as_json: bool) -> None:
    """Measure how long a step of the loop takes to close, in every mode, next to the same ring without ROS."""
    if quick:
        steps, repeats = 1000, 1
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that a SIGTERM ends the children too
    config = load_config(CONFIG)
    selection = config.ground_motion
    record = scale_time(read_ground_motion(selection.record), selection.time_scale)
    length = (steps - 1) * config.run.time_step
    duration = min(record.duration, round(math.floor(length / record.time_step + 1e-9) * record.time_step, 9))
    chosen = {
        "ground_motion.duration": duration,
        "ground_motion.free_vibration": round(length - duration, 9),
        **PATIENT,
    }
    settings = [word for key, value in chosen.items() for word in ("--set", f"{key}={value!r}")]
    config = config.changed(**{key.replace(".", "__"): value for key, value in chosen.items()})
    motion = select_ground_motion(config.ground_motion, config.run.time_step)
    expected = RthsLoop(config, motion).run().corrected_force
    machine = {
        "processors": os.cpu_count(),
        "python": platform.python_version(),
        "load_before": round(os.getloadavg()[0], 2),
        "gaps_over_1_ms_in_2_s_before": gaps(),
    }
    runs: dict[str, list[dict[str, Any]]] = {mode: [] for mode in MODES}
    beginning = processor_times()
    for repeat in range(repeats):
        for mode, (name, options, _) in MODES.items():
            print(f"repeat {repeat + 1} of {repeats}: {name}", file=sys.stderr, flush=True)
            if options is None:
                runs[mode].append(udp_run(config, motion, expected, lockstep=mode == "udp_free"))
            else:
                runs[mode].append(product_run(settings, options))
    machine["steal_percent_during"] = steal_percent(beginning, processor_times())
    machine["load_after"] = round(os.getloadavg()[0], 2)
    modes = {mode: summary(of_mode) for mode, of_mode in runs.items()}
    pairs = {
        **{mode: (mode, floor) for mode, (_, _, floor) in MODES.items()},
        "five_to_composed": ("five_paced", "composed_paced"),
    }
    ratios = {name: {k: modes[a][k] / modes[b][k] for k in ("p50", "p99")} for name, (a, b) in pairs.items()}
    result = {"machine": machine, "modes": modes, "ratios": ratios, "runs": runs}
    print(json.dumps(result)) if as_json else show(result)


if __name__ == "__main__":
    main()
