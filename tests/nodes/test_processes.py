"""The end of the processes of a run: asked once, asked again by the operator, killed."""

import os
import threading
import time

import pytest

from bmd_rths_nodes.run import processes as supervisor_module
from bmd_rths_nodes.run.processes import NodeProcesses
from tests.nodes.conftest import wait_until

#: A process that ends with the second SIGINT, and says how many have come.
STUBBORN = """
import signal, sys, time
received = []
signal.signal(signal.SIGINT, lambda *_: received.append(1) or print(len(received), flush=True))
print("ready", flush=True)
while len(received) < 2:
    time.sleep(0.01)
sys.exit(3)
"""


@pytest.fixture
def stubborn(tmp_path, monkeypatch):
    """Start the process; return what holds it, and what it is told."""
    (tmp_path / "stubborn.py").write_text(STUBBORN)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    processes = NodeProcesses(["stubborn"], tmp_path / "none.yaml", tmp_path)
    (process,) = processes.started
    wait_until(lambda: "ready" in process.log.read_text())
    yield processes
    process.process.kill()
    process.process.wait()


def test_further_interrupt_is_handed_on(stubborn):
    interrupts, told = [2], []
    threading.Timer(0.3, interrupts.append, [2]).start()
    stubborn.stop(1000.0, interrupts, told.append)
    (process,) = stubborn.started
    assert process.process.returncode == 3
    assert told == ["emergency stop (Ctrl-C again to leave at once)"]


def test_process_that_was_interrupted_before_is_not_interrupted_again_and_killed_in_the_end(stubborn, monkeypatch):
    """A second interrupt would be an emergency stop."""
    monkeypatch.setattr(supervisor_module, "PATIENCE", 0.5)
    (process,) = stubborn.started
    assert stubborn.first_runs
    stubborn.interrupt_first()
    wait_until(lambda: "1" in process.log.read_text())
    stubborn.stop(0.0, [], print)
    assert process.process.returncode == -9
    assert process.log.read_text().split() == ["ready", "1"]
    assert not stubborn.first_runs
    assert stubborn.lost() is process


def test_operator_who_asks_twice_more_does_not_wait_for_the_table(stubborn, monkeypatch):
    monkeypatch.setattr(supervisor_module, "PATIENCE", 0.5)
    (process,) = stubborn.started
    process.process.send_signal(19)  # SIGSTOP
    interrupts = []
    for delay in (0.1, 0.2):
        threading.Timer(delay, interrupts.append, [2]).start()
    stubborn.stop(1000.0, interrupts, print)
    assert process.process.returncode == -9


def test_processes_of_an_operator_in_a_hurry_are_asked_twice(stubborn):
    told = []
    stubborn.stop(1000.0, [2, 2, 2], told.append, hurried=True)
    (process,) = stubborn.started
    assert process.process.returncode == 3
    assert told == []


#: A process that ends when it is asked to, with a status; one that does not.
ON_SIGINT = """
import signal, sys, time
signal.signal(signal.SIGINT, {})
print("ready", flush=True)
time.sleep(99.0)
"""
ENDS, HANGS = "lambda *_: sys.exit({})", "signal.SIG_IGN"


#: The node of a run, with the time at which it enters the domain.
AT_THE_DOOR = "from bmd_rths_nodes.ros import spin; print('entered' if spin._let_in() else 'turned away', flush=True)"


@pytest.mark.parametrize("welcome", [True, False])
def test_nodes_load_but_enter_when_they_are_let_in_or_end(tmp_path, monkeypatch, welcome):
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    (tmp_path / "node.py").write_text(f"print('loaded', flush=True)\n{AT_THE_DOOR}")
    processes = NodeProcesses(["node"], tmp_path / "none.yaml", tmp_path)
    (node,) = processes.started
    wait_until(lambda: node.log.read_text() == "loaded\n")
    time.sleep(0.2)
    assert processes.lost() is None
    if welcome:
        processes.let_in()
        wait_until(lambda: processes.lost() is node)
    processes._answer_at_the_door("")
    wait_until(lambda: processes.lost() is node)
    assert node.log.read_text().split("\n")[1] == ("entered" if welcome else "turned away")


@pytest.mark.parametrize(("status", "at_rest"), [(0, True), (1, False)])
def test_way_to_rest_is_waited_for_until_its_process_has_ended_in_order(tmp_path, monkeypatch, status, at_rest):
    monkeypatch.setattr(supervisor_module, "PATIENCE", 0.2)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "table_driver.py").write_text(ON_SIGINT.format(ENDS.format(status)))
    (tmp_path / "hangs.py").write_text(ON_SIGINT.format(HANGS))
    processes = NodeProcesses(["hangs", "table_driver"], tmp_path / "none.yaml", tmp_path)
    wait_until(lambda: all("ready" in process.log.read_text() for process in processes.started))
    begin = time.monotonic()
    processes.stop(1000.0 if at_rest else 1.0, [], print)
    assert (time.monotonic() - begin < 10.0) if at_rest else (time.monotonic() - begin > 1.0)
    assert [process.process.returncode for process in processes.started] == [-9, status]
