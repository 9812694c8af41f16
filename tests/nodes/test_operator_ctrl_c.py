"""Ctrl-C of `bmd-rths run`: the first brings the table to rest, the second is an emergency stop, the third leaves."""

import json
import os
import signal

import pytest
from rosbags.highlevel import AnyReader

from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.table.wire import Interlock
from bmd_rths_msgs_py.bag_reader import read_bag
from tests.conftest import WITHOUT_LIMITS
from tests.nodes.conftest import CONFIG, processes_of_domain, recorded
from tests.nodes.emulation import LOCKSTEP, emulator

#: Long steps, no limits and a way to rest of many seconds, so that a busy machine does not end the test, and a second
#: Ctrl-C comes before the end of the ramp.
SLOW = {
    "run__time_step": 0.02,
    "table__answer_timeout": 0.012,
    "run__longest_miss_time": 40,
    "run__preflight": "skip",
    "run__settling_time": 0.0,  # nobody else is on the domain
    "safety__stale_shear_time": 200,
    "safety__stale_controller_time": 200,
    "safety__ramp_acceleration": 0.02,
    "safety__ramp_velocity": 0.01,
    "ground_motion__time_scale": 1.0,
    "run__scheme": "uc",
    "numerical_substructure__masses": [8.0e6],
    **WITHOUT_LIMITS,
}


def arguments(**changes):
    return [word for name, value in changes.items() for word in ("--set", f"{name.replace('__', '.')}={value}")]


def begun(folder):
    """Tell whether a bag has some hundred messages."""
    return recorded(folder, 50_000) is not None


def told_by_the_table_driver(bag):
    """Return every status of the table driver in a bag."""
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic == "/diagnostics"]
        messages = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)]
    return [s for m in messages for s in m.status if s.name == "/rths/table_driver"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("controller", "options"),
    [("simulated", ("--composed",)), ("udp", ("--composed",)), ("udp", ())],
    ids=["simulated, composed", "udp, composed", "udp, five processes"],
)
def test_second_ctrl_c_is_an_emergency_stop(bmd_rths, tmp_path, domain, controller, options):
    changes = SLOW | {"virtual_controller__watchdog": 10.0, "virtual_controller__model": "servo"}
    with emulator(LOCKSTEP.changed(run__lockstep=False, **changes)) as (server, config):
        table = config.table.address if controller == "udp" else "simulated"
        child = bmd_rths(
            "run", CONFIG, "--table", table, *options, *arguments(**SLOW), "--output", tmp_path / "bags", "--json"
        )
        child.wait_for(lambda: begun(tmp_path / "bags"))
        child.interrupt()
        child.wait_for_words("table driver: the table is brought to rest, after step")
        child.interrupt()
        result = child.wait(60.0)
        if controller == "udp":
            assert server.statistics()["state"] == "interlock"
            assert server.statistics()["interlock"] == Interlock.EMERGENCY_STOP
    assert result.status == 1
    assert "Traceback" not in result.errors
    assert "emergency stop (Ctrl-C again to leave at once)" in result.errors
    assert "table driver: emergency stop: the table controller was told to stop at once" in result.errors
    told = json.loads(result.output)
    reason = "table_driver: stopped by the operator; table_driver: emergency stop by the operator"
    assert (told["outcome"], told["reason"]) == ("stopped", reason)
    (bag,) = (tmp_path / "bags").iterdir()
    assert read_bag(bag).outcome == "stopped"
    assert "emergency stop by the operator" in {told.message for told in told_by_the_table_driver(bag)}
    assert processes_of_domain(domain) == {}


@pytest.mark.slow
def test_one_ctrl_c_brings_a_table_on_the_network_to_rest_without_its_interlock(bmd_rths, tmp_path, domain):
    changes = SLOW | {"virtual_controller__watchdog": 10.0, "virtual_controller__model": "servo"}
    quick = SLOW | {"safety__ramp_acceleration": 5.0, "safety__ramp_velocity": 0.2}
    with emulator(LOCKSTEP.changed(run__lockstep=False, **changes)) as (server, config):
        child = bmd_rths(
            *("run", CONFIG, "--composed", "--table", config.table.address, *arguments(**quick)),
            *("--output", tmp_path / "bags", "--json"),
        )
        child.wait_for(lambda: begun(tmp_path / "bags"))
        child.interrupt()
        result = child.wait(60.0)
        assert server.statistics()["state"] == "idle"
        assert server.statistics()["interlock"] == 0
    assert result.status == 1
    assert "stopping: the table is brought to rest (Ctrl-C again for an emergency stop)" in result.errors
    assert json.loads(result.output)["outcome"] == "stopped"
    assert processes_of_domain(domain) == {}


@pytest.mark.slow
def test_run_waits_for_a_way_to_rest_of_many_seconds_and_records_its_end(bmd_rths, tmp_path, domain):
    """Where the test is stopped the table is some 80 mm off: longer than the recorder is waited for at rest."""
    ramp = SLOW | {"safety__ramp_acceleration": 5.0, "safety__ramp_velocity": 0.012}
    child = bmd_rths("run", CONFIG, "--composed", *arguments(**ramp), "--output", tmp_path / "bags", "--json")
    child.wait_for(lambda: recorded(tmp_path / "bags", 130_000))
    child.interrupt()
    result = child.wait()
    assert result.status == 1
    assert "Traceback" not in result.errors
    told = json.loads(result.output)
    assert told["outcome"] == "stopped"
    (bag,) = (tmp_path / "bags").iterdir()
    assert told["bag"] == str(bag)
    record = read_bag(bag)
    assert (record.outcome, record.reason) == ("stopped", "table_driver: stopped by the operator")
    assert 0 < record.steps < 900  # of the whole record
    last = {pair.key: pair.value for pair in told_by_the_table_driver(bag)[-1].values}
    assert (last["table"], last["supervisor"]) == ("at rest", "stopped")
    assert abs(float(last["displacement"])) < 1e-3
    assert processes_of_domain(domain) == {}


@pytest.mark.slow
def test_nodes_that_are_ended_by_a_signal_record_the_way_to_rest_to_its_end(start, tmp_path):
    """As a launch system ends them, all at once. The way to rest takes longer than the recorder would stay without."""
    changes = SLOW | {"safety__ramp_acceleration": 5.0, "safety__ramp_velocity": 0.024}
    config = Config().changed(**changes, recorder__directory=str(tmp_path / "bags"))
    (tmp_path / "parameters.yaml").write_text(dump_config(config))
    modules = ("composed_loop", "recorder")
    nodes = [
        start("-m", f"bmd_rths_nodes.nodes.{module}", "--ros-args", "--params-file", tmp_path / "parameters.yaml")
        for module in modules
    ]
    nodes[0].wait_for(lambda: recorded(tmp_path / "bags", 130_000))
    for node in nodes:
        node.interrupt()
    assert [node.wait(60.0).status for node in nodes] == [0, 0]
    (bag,) = (tmp_path / "bags").iterdir()
    assert read_bag(bag).outcome == "stopped"
    last = {pair.key: pair.value for pair in told_by_the_table_driver(bag)[-1].values}
    assert (last["table"], last["supervisor"]) == ("at rest", "stopped")


@pytest.mark.slow
def test_third_ctrl_c_does_not_wait_for_a_table_driver_that_hangs(bmd_rths, tmp_path, domain):
    child = bmd_rths("run", CONFIG, *arguments(**SLOW), "--output", tmp_path / "bags", "--json")
    child.wait_for(lambda: begun(tmp_path / "bags"))
    (driver,) = (pid for pid, command in processes_of_domain(domain).items() if "table_driver" in command)
    os.kill(driver, signal.SIGSTOP)
    child.interrupt()
    child.wait_for_words("the table driver does not answer; the numerical substructure is")
    child.interrupt()
    child.wait_for_words("emergency stop (Ctrl-C again")
    child.interrupt()
    result = child.wait(60.0)
    assert result.status == 1
    assert "Traceback" not in result.errors
    assert processes_of_domain(domain) == {}
    (bag,) = (tmp_path / "bags").iterdir()
    assert read_bag(bag).outcome == "stopped"
