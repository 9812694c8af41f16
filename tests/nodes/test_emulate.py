"""`bmd-rths emulate` and `bmd-rths run --table udp://...`: two programs, one test."""

import json
import signal
import socket

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from bmd_rths_core.config import load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from tests.nodes.conftest import CONFIG, processes_of_domain, wait_until


class Emulated:
    """An emulator in a process of its own, on a free port."""

    def __init__(self, child):
        self.child = child
        line = wait_until(lambda: self.child.output.read_text().partition("\n")[0] or self._ended())
        self.ready = json.loads(line)
        self.table = f"udp://127.0.0.1:{self.ready['port']}"

    def _ended(self):
        assert self.child.process.poll() is None, self.child.errors.read_text()

    def tell(self, line):
        """Say something on the control port and return what it says."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
            control.settimeout(20.0)
            control.sendto(line.encode(), ("127.0.0.1", self.ready["control_port"]))
            return json.loads(control.recv(4096))


@pytest.fixture
def emulate(bmd_rths):
    """Start an emulator with arguments."""
    return lambda *arguments: Emulated(
        bmd_rths("emulate", CONFIG, "--listen", "udp://127.0.0.1:0", "--json", *arguments)
    )


def in_process(**changes):
    config = load_config(CONFIG).changed(**changes)
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


def told_by_the_table_driver(bag):
    """Return every status of the table driver in a bag."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic == "/diagnostics"]
        messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)]
    return [
        {pair.key: pair.value for pair in status.values}
        for message in messages
        for status in message.status
        if status.name == "/rths/table_driver"
    ]


@pytest.mark.slow
def test_lockstep_run_over_udp_equals_the_loop_in_process_bit_for_bit(emulate, run_main, tmp_path):
    emulated = emulate("--plant", "servo")
    settings = ("--lockstep", "--composed", "--set", "ground_motion.duration=6.0")
    how = (*settings, "--output", tmp_path, "--json")
    status, output, errors = run_main("run", CONFIG, "--table", emulated.table, *how)
    assert status == 0, errors
    bag = json.loads(output)["bag"]
    record = read_bag(bag)
    assert record.configuration["table"]["address"] == emulated.table
    assert record.steps == 1201
    assert record.same_signals(in_process(ground_motion__duration=6.0))
    last = told_by_the_table_driver(tmp_path / bag.rpartition("/")[2])[-1]
    assert int(last["udp_answered"]) >= 1201
    assert last["udp_crc"] == last["udp_lost"] == "0"
    wait_until(lambda: emulated.tell("status")["state"] == "idle")
    told = emulated.tell("status")
    assert told["at_rest"] is True
    assert abs(told["velocity"]) < 1e-3
    # What is recorded has the noise of the sensor.
    peak = np.nanmax(np.abs(record.continued("table_displacement")))
    assert told["peak_displacement"] >= peak - 5 * 5e-5 > 0.005
    assert told["peak_displacement"] < 0.1
    emulated.child.interrupt()
    ended = emulated.child.wait(20.0)
    assert ended.status == 0
    assert "Traceback" not in ended.errors
    assert "state idle" in ended.errors


@pytest.mark.slow
def test_real_time_run_over_a_lossy_network_goes_on_and_counts_in_the_bag(emulate, run_main, tmp_path):
    """Long steps, a patient watchdog and a building too heavy to feel the shear: a busy machine does not end it."""
    emulated = emulate("--fault", "loss=3", "--fault", "bit_flips=3", "--set", "virtual_controller.watchdog=5.0")
    settings = (
        *("run.time_step=0.02", "table.answer_timeout=0.012", "run.longest_miss_time=8", "run.settling_time=0.0"),
        *("safety.stale_controller_time=2.0", "safety.stale_shear_time=2.0", "run.preflight=skip"),
        *("numerical_substructure.masses=[8.0e+6]", "ground_motion.duration=4.0"),
    )
    arguments = [argument for setting in settings for argument in ("--set", setting)]
    arguments += ["--scheme", "uc", "--output", tmp_path, "--json"]
    status, output, errors = run_main("run", CONFIG, "--table", emulated.table, "--composed", *arguments)
    assert status == 0, output + errors
    told = json.loads(output)
    statuses = told_by_the_table_driver(tmp_path / told["bag"].rpartition("/")[2])
    last = next(status for status in statuses if status["state"] == "ended")  # before the way to rest
    assert int(last["udp_lost"]) > 0
    assert int(last["udp_crc"]) + int(last["udp_magic"]) + int(last["udp_version"]) > 0
    # Every command without an answer is a missed deadline, and a row without sensors.
    record = read_bag(told["bag"])
    assert told["missed_deadlines"] >= np.isnan(record.applied_command).sum() >= int(last["udp_lost"])
    assert np.nanmax(np.abs(record.table_displacement)) > 0.005


@pytest.mark.slow
def test_controller_that_freezes_during_a_run_ends_it_with_its_name(emulate, bmd_rths, tmp_path, domain):
    emulated = emulate("--plant", "servo")
    settings = ("--lockstep", "--composed", "--set", "ground_motion.free_vibration=600.0")
    settings += ("--set", "run.preflight=skip")
    child = bmd_rths("run", CONFIG, "--table", emulated.table, *settings, "--output", tmp_path, "--json")
    wait_until(lambda: emulated.tell("status").get("received", 0) > 100)
    emulated.tell("frozen")
    result = child.wait(60.0)
    assert result.status == 1
    told = json.loads(result.output)
    assert told["outcome"] == "failed"
    assert f"table controller at step {told['steps'] - 1}: {emulated.table} answers" in told["reason"]
    assert processes_of_domain(domain) == {}


@pytest.mark.slow
def test_run_without_a_controller_says_so_and_whose_prediction_it_was(run_main, tmp_path, domain):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        table = f"udp://127.0.0.1:{nobody.getsockname()[1]}"
        status, _, errors = run_main("run", CONFIG, "--table", table, "--composed", "--output", tmp_path)
    assert status == 1
    assert "predicted for the model in simulated_table, not udp: displacement" in errors
    assert f"table controller: no answer from {table} within 1.5 s: it is not there, or another" in errors
    assert processes_of_domain(domain) == {}


def test_faults_are_changed_and_interlocks_reset_at_run_time(emulate):
    emulated = emulate("--plant", "servo")
    assert emulated.tell("status")["state"] == "idle"
    assert "error" not in emulated.tell("loss=50")
    assert "error" not in emulated.tell("clear loss")
    assert "error" not in emulated.tell("reset")
    assert "NAME[=VALUE][@STEP]" in emulated.tell("lose=50")["error"]
    assert "no hydraulics" in emulated.tell("pressure=50")["error"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_emulator_ends_on_a_signal_with_its_statistics(emulate, number):
    emulated = emulate()
    emulated.child.process.send_signal(number)
    ended = emulated.child.wait(20.0)
    assert ended.status == 0
    assert ended.output.count("\n") == 1
    assert "answered 0" in ended.errors
    assert "Traceback" not in ended.errors


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("emulate", CONFIG, "--fault", "los"), ["fault 'los'", "loss"]),
        (("emulate", CONFIG, "--plant", "servo", "--fault", "valve=1"), ["fault 'valve=1'", "servo_hydraulic"]),
        (("emulate", CONFIG, "--listen", "127.0.0.1:5"), ["--listen", "udp://HOST:PORT"]),
        (("emulate", CONFIG, "--listen", "udp://192.0.2.1:5005"), ["udp://192.0.2.1:5005", "cannot be used"]),
        (("emulate", "none.yaml"), ["none.yaml", "No such file"]),
        (("run", CONFIG, "--table", "udp://127.0.0.1"), ["table.address", "udp://HOST:PORT"]),
        (("run", CONFIG, "--table", "flextest"), ["table.controller", "'flextest'", "simulated, udp"]),
        (("run", CONFIG, "--table", "udp", "--set", "table.answer_timeout=0.01"), ["table.answer_timeout", "0.005 s"]),
        (("simulate", CONFIG, "--set", "table.controller=udp"), ["table.controller", "'udp'", "simulated"]),
    ],
)
def test_wrong_input_has_status_2_and_one_clear_line(run_main, tmp_path, arguments, named):
    status, output, errors = run_main(*arguments)
    assert (status, output) == (2, "")
    assert errors.startswith("error: ")
    assert errors.count("\n") == 1
    for text in named:
        assert text in errors
    assert list(tmp_path.iterdir()) == []


def test_help_has_an_example_and_every_fault(run_main):
    status, output, _ = run_main("emulate", "--help")
    assert status == 0
    for text in ("Example: bmd-rths emulate", "loss", "pressure", "NAME[=VALUE][@STEP]"):
        assert text in output
