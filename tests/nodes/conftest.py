"""Real middleware for every test: a domain of its own, child processes that never outlive it."""

import faulthandler
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

from bmd_rths_core import RthsLoop, load_config, select_ground_motion
from bmd_rths_core.loop.states import NodeState
from bmd_rths_msgs_py.record_bag import write_record
from bmd_rths_nodes.cli.main import main
from bmd_rths_nodes.hardware.controllers import make_table_controller
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.middleware import PROFILES, RANGE, TRANSPORTS, prepare_middleware
from bmd_rths_nodes.ros.status import NodeStatus
from tests.conftest import made_once
from tests.domains import free_domain, ports_of
from tests.nodes.scripted_controller import REAL_TIME, Script

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "config" / "simplified_bmd.yaml"
EIGHT_STORY = ROOT / "config" / "eight_story_bmd.yaml"


@pytest.fixture(autouse=True)
def domain(monkeypatch):
    """Give the test a ROS domain of its own, on this machine only, whoever else runs these tests at the same time."""
    with free_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv(RANGE, "LOCALHOST")
        for name in (PROFILES, TRANSPORTS):
            monkeypatch.setenv(name, "")  # so that it is put back in the end
            monkeypatch.delenv(name)
        prepare_middleware()  # for the nodes of this process too
        yield number
        assert not ports_of(number), "a node of this process is still on the domain"


@pytest.fixture
def run_main(monkeypatch, capsys, tmp_path):
    """Run the command line in this process, in an empty folder; return status, standard output and error."""
    monkeypatch.chdir(tmp_path)
    # The executor of rclpy enables it on standard error, which is captured; pytest has done so already.
    monkeypatch.setattr(faulthandler, "enable", lambda: None)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["bmd-rths", *(str(a) for a in arguments)])
        status = main()
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


class Child:
    """A process with its output in files, so that nothing waits for a pipe."""

    def __init__(self, folder, arguments, environment=None):
        self.output, self.errors = folder / "stdout.txt", folder / "stderr.txt"
        self.is_parent = not any("bmd_rths_nodes.nodes." in str(argument) for argument in arguments)
        with open(self.output, "wb") as out, open(self.errors, "wb") as err:
            self.process = subprocess.Popen(
                [sys.executable, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                cwd=folder,
                env=environment,
            )

    def wait(self, timeout=120.0):
        """Wait for the end and return exit status, standard output and standard error."""
        status = self.process.wait(timeout)
        return SimpleNamespace(status=status, output=self.output.read_text(), errors=self.errors.read_text())

    def interrupt(self):
        self.process.send_signal(signal.SIGINT)

    def wait_for(self, condition, timeout=60.0):
        """Wait until something is so; show what it wrote to standard error, if it is not or it has ended before."""
        with suppress(AssertionError):
            wait_until(lambda: condition() or self.process.poll() is not None, timeout)
        assert condition(), f"status {self.process.poll()}:\n{self.errors.read_text()}"

    def wait_for_words(self, words, timeout=60.0):
        """Wait until it has written something to standard error."""
        self.wait_for(lambda: words in self.errors.read_text(), timeout)


def end(children):
    """End what is left of some children, all at the same time: ask one that has processes of its own, kill the rest."""
    for child in children:
        if child.process.poll() is None:
            child.interrupt() if child.is_parent else child.process.kill()
    give_up = time.monotonic() + 10.0
    for child in children:
        try:
            child.process.wait(max(0.0, give_up - time.monotonic()))
        except subprocess.TimeoutExpired:
            child.process.kill()
            child.process.wait()


def leave_none(number):
    """Wait until no process of a domain is left: nodes whose parent was killed bring the table to rest first."""
    with suppress(AssertionError):
        wait_until(lambda: not processes_of_domain(number), 30.0)
    left = processes_of_domain(number)
    for pid in left:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    assert left == {}


@pytest.fixture
def start(tmp_path, domain):
    """Start Python with arguments in a folder of its own; whatever is left at the end is killed.

    The next test on this domain shall find nobody.
    """
    children = []

    def start_child(*arguments):
        folder = tmp_path / f"child_{len(children)}"
        folder.mkdir()
        children.append(Child(folder, [str(a) for a in arguments]))
        return children[-1]

    yield start_child
    end(children)
    if children:
        leave_none(domain)


@pytest.fixture
def bmd_rths(start):
    """Start the command line."""
    return lambda *arguments: start("-m", "bmd_rths_nodes.cli.main", *arguments)


@pytest.fixture(scope="session")
def composed_run(tmp_path_factory):
    """Run three seconds in lockstep in two processes, once, for tests that only look at what came of it.

    Output and errors, and what was `told` as JSON; nobody changes the bag.
    """
    folder = made_once(tmp_path_factory, "composed", _run_composed)
    result = SimpleNamespace(output=(folder / "stdout.txt").read_text(), errors=(folder / "stderr.txt").read_text())
    result.told = json.loads(result.output)
    return result


def _run_composed(folder):
    arguments = ("--lockstep", "--composed", "--set", "ground_motion.duration=3.0", "--output", folder, "--json")
    with free_domain() as number:
        own = {"ROS_DOMAIN_ID": str(number), RANGE: "LOCALHOST"}
        command = ["-m", "bmd_rths_nodes.cli.main", "run", *(str(a) for a in (CONFIG, *arguments))]
        child = Child(folder, command, {**os.environ, **own})
        try:
            result = child.wait()
        finally:
            end([child])
    assert result.status == 0, result.errors


@pytest.fixture
def records(tmp_path):
    """Write two records of saw teeth, 0.8 s long, and a file that is none."""
    folder = tmp_path / "records"
    folder.mkdir()
    motion = "time_s,acceleration_g\n" + "".join(f"{0.01 * i:.2f},{{}}\n" for i in range(80))
    for name, factor in (("kobe", 1), ("other", -2)):
        values = [f"{factor * (i % 20 - 10) / 100:.3f}" for i in range(80)]
        (folder / f"{name}.csv").write_text(motion.format(*values))
    (folder / "README.md").write_text("Records\n")
    return folder


@pytest.fixture(scope="session")
def simulated():
    """Simulate three seconds in process, once."""
    config = load_config(CONFIG).changed(ground_motion__duration=3.0)
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


@pytest.fixture(scope="session")
def campaign_folder(simulated, tmp_path_factory):
    """Make the folder of a campaign with one bag that is kept and one that is not; nobody changes it."""
    folder = tmp_path_factory.mktemp("campaign")
    write_record(simulated, folder / "bags" / "el_centro_1940_ns_plc_fc_0123456789ab")
    (folder / "campaign.csv").write_text(
        "key,motion,scheme,variation,outcome,verdict,rmse_substructure_percent\n"
        "0123456789abcdef,el_centro_1940_ns,plc_fc,'=1+1,finished,good,12.5\n"
        "fedcba9876543210,el_centro_1940_ns,uc,{},limit,bad,\n"
    )
    return folder


@pytest.fixture
def client(domain):
    """Return a plain ROS node in this process, and a way to call services with it."""
    context = rclpy.Context()
    context.init(args=[], domain_id=domain)
    node = rclpy.create_node("client", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def call(service_type, name, request):
        service = node.create_client(service_type, name)
        wait_until(service.service_is_ready, 30.0)  # rclpy itself looks only four times a second
        for _ in range(3):
            future = service.call_async(request)
            executor.spin_until_future_complete(future, timeout_sec=10.0)
            if future.done():
                break  # otherwise the answer came before the server had found this client, and is lost
        node.destroy_client(service)
        assert future.done(), name
        return future.result()

    node.call = call
    node.spin_some = lambda: executor.spin_once(timeout_sec=0.02)
    yield node
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


class Substructure:
    """A numerical substructure, as far as a client tells of itself that it is one."""

    def __init__(self, client):
        self._client, self._number = client, 0
        self._diagnostics = client.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))

    def tell(self, state):
        values = {"run": f"test {self._number}", "instance": "client"}
        told = NodeStatus("/rths/numerical_substructure", state, values=values)
        self._diagnostics.publish(status.to_message(told, int(time.time()), 0))
        self._client.spin_some()

    def offer(self, run_of_driver):
        """Offer a new test, until the driver tells that it takes part."""
        self._number += 1
        wait_until(lambda: self.tell(NodeState.WAITING) or run_of_driver() == f"test {self._number}")


@pytest.fixture
def scripted():
    """Make a connected table whose commands are answered by a function."""
    made = []

    def make(on_command, config=REAL_TIME):
        script = Script(on_command)
        table = make_table_controller(
            config.changed(table__address=f"udp://127.0.0.1:{script.socket.getsockname()[1]}")
        )
        made.extend((table, script))
        table.connect()
        return table, script

    yield make
    for one in made:
        one.close()


def change_state(client, transition, role="command_shaper"):
    request = ChangeState.Request(transition=Transition(id=transition))
    return client.call(ChangeState, f"/rths/{role}/change_state", request).success


def processes_of_domain(number):
    """Return process id and command line of every node process on a ROS domain."""
    found = {}
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
            environment = (folder / "environ").read_bytes().split(b"\0")
        except OSError:
            continue
        is_node = "bmd_rths_nodes" in command and "cli.main" not in command
        if is_node and f"ROS_DOMAIN_ID={number}".encode() in environment:
            found[int(folder.name)] = command
    return found


def recorded(folder, size, name="*"):
    """Return the MCAP file below a folder that has so many bytes since the first corrected shear, if there is one.

    What the nodes tell before step 0 is recorded too, as long as they wait for each other.
    """
    for file in folder.glob(f"{name}/*.mcap"):
        data = file.read_bytes()
        begin = data.find(b"/rths/corrected_force")  # the channel is made with its first message
        if begin >= 0 and len(data) - begin > size:
            return file
    return None


def wait_until(condition, timeout=60.0):
    """Wait for a condition, and return its value."""
    end = time.monotonic() + timeout
    while not (value := condition()):
        assert time.monotonic() < end, "the condition did not come true in time"
        time.sleep(0.02)
    return value
