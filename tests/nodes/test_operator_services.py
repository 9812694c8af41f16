"""The operator's services of the table driver: stop, emergency stop and reset."""

import socket
import time
from contextlib import suppress
from itertools import count

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from lifecycle_msgs.msg import Transition
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from bmd_rths_core.loop.states import NodeState
from bmd_rths_core.loop.table_driver import NOT_CONFIRMED
from bmd_rths_core.table.emulated.faults import parse_fault
from bmd_rths_core.table.wire import Interlock
from tests.nodes.conftest import Substructure, change_state, wait_until
from tests.nodes.emulation import LOCKSTEP, emulator

#: The slowest way to rest that is allowed. After two steps at 1 m/s² it takes 1 s to brake, and 5 s over 5 mm back.
SLOW_WAY_TO_REST = ("safety.ramp_acceleration:=0.01", "safety.ramp_velocity:=0.001")


def ask(client, service):
    """Call a service of the table driver and return whether it did it, and its words."""
    response = client.call(Trigger, f"/rths/table_driver/{service}", Trigger.Request())
    return response.success, response.message


def flood(client, service, calls):
    """Call a service of the table driver so often at once, by a client that keeps every answer; return them."""
    patient = client.create_client(Trigger, f"/rths/table_driver/{service}", qos_profile=QoSProfile(depth=2 * calls))
    wait_until(patient.service_is_ready)
    ask(client, service)  # an answer that comes before the server has found a client is lost
    for _ in range(20):
        client.spin_some()
    futures = [patient.call_async(Trigger.Request()) for _ in range(calls)]
    with suppress(AssertionError):
        wait_until(lambda: [client.spin_some() for _ in range(20)] and all(f.done() for f in futures), 30.0)
    return [future.result().message for future in futures if future.done()]


class Driver:
    """A table driver in a process of its own, with a client that plays the rest of the loop."""

    def __init__(self, client, start, *parameters):
        self.told, self.measured = {}, []
        self._client = client
        # In this order: where a status comes through, a measurement does.
        client.create_subscription(JointTrajectory, "/rths/measurement", self.measured.append, QoSProfile(depth=10))
        client.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=10))
        self._commands = client.create_publisher(AccelStamped, "/rths/command", QoSProfile(depth=10))
        self.substructure = Substructure(client)
        given = [word for parameter in ("run.record:=false", *parameters) for word in ("-p", parameter)]
        self.child = start("-m", "bmd_rths_nodes.nodes.table_driver", "--ros-args", *given)

    def _on_diagnostics(self, message):
        for entry in message.status:
            if entry.name == "/rths/table_driver":
                self.told = {pair.key: pair.value for pair in entry.values} | {"message": entry.message}

    def send(self, step, acceleration=0.5):
        message = AccelStamped()
        message.header.stamp.nanosec = 5_000_000 * step
        message.accel.linear.x = acceleration
        self._commands.publish(message)
        self._client.spin_some()

    def offer_test(self):
        """Let the two sides meet, and agree on a test."""
        wait_until(lambda: self._client.spin_some() or self._commands.get_subscription_count())
        self.substructure.offer(lambda: self.told.get("run"))

    def move(self, acceleration=0.5):
        """Begin a test. Step 0 goes out once: a second one would begin another test."""
        self.offer_test()
        self.measured.clear()
        steps = count()
        self.send(next(steps), acceleration)
        self.send(next(steps), acceleration)
        # By the clock a measurement that comes late is none, on a busy machine; the table moves on meanwhile.
        wait_until(lambda: self._measured_within(0.2) or self.send(next(steps), acceleration))

    def _measured_within(self, seconds):
        end = time.monotonic() + seconds
        while not self.measured and time.monotonic() < end:
            self._client.spin_some()
        return bool(self.measured)

    def wait_for(self, **values):
        def there():
            self._client.spin_some()
            return values.items() <= self.told.items()

        wait_until(there)


@pytest.fixture
def driver(client, start):
    """Start a table driver in lockstep, with further parameters."""
    return lambda *parameters: Driver(client, start, "run.lockstep:=true", *parameters)


@pytest.mark.slow
def test_stop_ramps_to_rest_and_is_latched_until_reset(client, driver):
    table = driver()
    table.move()
    assert ask(client, "stop") == (True, "the table is brought to rest, after step 1")
    table.wait_for(state="tripped", table="at rest", outcome="stopped", message="stopped by the operator")
    assert ask(client, "stop") == (True, "the table is at rest already")
    table.measured.clear()
    for step in (*range(2, 20), 0, 1):
        table.send(step)
    # What comes now is the end of the way to rest, whose steps are those after 20.
    assert [message for message in table.measured if message.header.stamp.nanosec < 20 * 5_000_000] == []
    assert ask(client, "reset") == (True, "armed for a new test")
    table.wait_for(state="waiting", outcome="", trips="")
    table.move()
    table.wait_for(table="moving")


@pytest.mark.slow
def test_emergency_stop_acts_also_on_the_way_to_rest(client, driver):
    """In real time, with a way to rest of many seconds."""
    table = driver("run.lockstep:=false", "safety.ramp_acceleration:=0.01", "safety.stale_shear_time:=500")
    table.move()
    assert ask(client, "stop")[0]
    table.wait_for(state="tripped", table="moving")
    assert ask(client, "stop") == (True, "the table is on its way to rest already")
    assert ask(client, "reset") == (False, "the table is still on its way to rest")
    done, words = ask(client, "emergency_stop")
    assert done
    assert words.startswith("emergency stop: the table controller was told to stop at once, after step")
    table.wait_for(state="tripped", table="at rest", supervisor="stopped", message="emergency stop by the operator")
    assert ask(client, "reset") == (True, "armed for a new test")


@pytest.mark.slow
def test_stop_before_step_0_keeps_a_test_from_beginning(client, driver):
    table = driver()
    wait_until(lambda: client.spin_some() or table.told.get("state") == "waiting")
    assert ask(client, "stop") == (True, "the table is at rest; no test begins before a reset")
    table.wait_for(state="tripped", table="at rest")


@pytest.mark.slow
def test_tripped_driver_is_reset_and_a_hold_is_brought_back_first(client, driver):
    table = driver(
        "safety.acceleration_limit:=1.0", "safety.ramp_acceleration:=1.0", "safety.acceleration_action:=hold"
    )
    table.move()
    wait_until(lambda: table.send(2, 3.0) or table.told.get("state") == "tripped")
    table.wait_for(supervisor="holding", table="at rest")
    assert ask(client, "reset") == (False, "the table is held off zero displacement; stop brings it back first")
    assert ask(client, "stop") == (True, "the hold has ended; the table is brought back to zero displacement")
    table.wait_for(supervisor="stopped", table="at rest")
    assert "safety.acceleration_limit [m/s2] passed at step 2" in table.told["trips"]
    assert ask(client, "reset") == (True, "armed for a new test")
    table.wait_for(state="waiting", trips="")


@pytest.mark.slow
def test_stop_acts_at_once_after_sensors_have_passed_a_limit_that_waits_for_the_next_command(client, driver):
    table = driver("safety.force_limit:=0.001", "safety.force_action:=hold")
    table.offer_test()
    wait_until(lambda: table.send(0) or table.measured)
    assert ask(client, "stop") == (True, "the table is brought to rest, after step 0")
    table.wait_for(state="tripped", supervisor="stopped", table="at rest", outcome="stopped")
    assert "safety.force_limit [N] passed at step 0" in table.told["trips"]


@pytest.mark.slow
def test_reset_is_refused_while_there_is_nothing_to_reset_or_a_test_runs(client, driver):
    table = driver()
    wait_until(lambda: client.spin_some() or table.told.get("state") == "waiting")
    assert ask(client, "reset") == (False, "there is nothing to reset: the table driver is waiting")
    table.move()
    ask(client, "stop")
    table.wait_for(state="tripped", table="at rest")

    def refused():
        table.substructure.tell(NodeState.RUNNING)
        return ask(client, "reset") == (False, "a test is running; stop it first")

    wait_until(refused)
    wait_until(lambda: table.substructure.tell(NodeState.ENDED) or ask(client, "reset")[0])


@pytest.mark.slow
def test_inactive_driver_answers_that_it_moves_nothing(client, driver):
    driver("autostart:=false")
    services, answer = ("stop", "emergency_stop", "reset"), (False, "the table driver is inactive; it moves nothing")
    assert [ask(client, service) for service in services] == [answer] * 3
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP) * 2:
        assert change_state(client, transition, "table_driver")
        assert [ask(client, service) for service in services] == [answer] * 3


@pytest.mark.slow
def test_emergency_stop_reaches_the_controller_whose_interlock_only_it_can_reset(client, driver):
    with emulator() as (server, config):
        table = driver("table.controller:=udp", f"table.address:={config.table.address}")
        table.move()
        assert ask(client, "emergency_stop")[0]
        assert server.statistics()["state"] == "interlock"
        assert server.statistics()["interlock"] == Interlock.EMERGENCY_STOP
        done, words = ask(client, "reset")
        assert not done
        assert "is in an interlock (emergency stop); look at the table, then reset the interlock there" in words
        table.wait_for(state="tripped")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
            control.settimeout(20.0)
            control.sendto(b"reset", ("127.0.0.1", server.control_port))
            control.recv(4096)
        assert ask(client, "reset") == (True, "armed for a new test")
        assert server.statistics()["state"] == "armed"
        table.move()
        # A driver that ends brings the table to rest, which takes a controller that is there.
        table.child.interrupt()
        assert table.child.wait(20.0).status == 0
        assert server.statistics()["state"] == "idle"


@pytest.mark.slow
def test_second_ctrl_c_of_a_driver_that_was_started_by_hand_is_an_emergency_stop(client, driver):
    """With a way to rest of many seconds, on which a driver that ends does not answer its services any more."""
    with emulator(LOCKSTEP.changed(run__lockstep=False, virtual_controller__watchdog=10.0)) as (server, config):
        # On a busy machine answers are lost, and a command is held for longer.
        patient = ("safety.stale_shear_time:=500", "safety.stale_controller_time:=500")
        slow = ("run.lockstep:=false", "safety.ramp_velocity:=0.001", *patient)
        table = driver("table.controller:=udp", f"table.address:={config.table.address}", *slow)
        table.move(0.05)
        wait_until(lambda: abs(server.statistics()["displacement"]) > 0.003)
        table.child.interrupt()
        table.child.interrupt()  # a launch system and the terminal may both send it for one Ctrl-C
        end = time.monotonic() + 2.0
        wait_until(lambda: client.spin_some() or time.monotonic() > end)
        assert server.statistics()["state"] == "running"
        table.child.interrupt()
        assert table.child.wait(30.0).status == 0
        assert server.statistics()["state"] == "interlock"
        assert server.statistics()["interlock"] == Interlock.EMERGENCY_STOP


@pytest.mark.slow
def test_each_call_of_a_flood_is_answered(client, start):
    start("-m", "bmd_rths_nodes.nodes.table_driver", "--ros-args", "-p", "run.record:=false")
    answers = flood(client, "reset", 500)
    assert len(answers) == 500
    assert all(answer.startswith("there is nothing to reset") for answer in answers)


@pytest.mark.slow
def test_emergency_stops_do_not_wait_one_by_one_for_a_controller_that_is_silent(client, start):
    with emulator(LOCKSTEP.changed(run__lockstep=False)) as (server, connected):
        table = {"controller": "udp", "address": connected.table.address, "give_up_after": 0.5}
        given = [word for name, value in table.items() for word in ("-p", f"table.{name}:={value}")]
        start("-m", "bmd_rths_nodes.nodes.table_driver", "--ros-args", "-p", "run.record:=false", *given)
        wait_until(lambda: server.statistics()["state"] == "armed")
        server._faults.set(parse_fault("dead"))
        begin = time.monotonic()
        answers = flood(client, "emergency_stop", 100)
        assert len(answers) == 100
        assert all(answer.endswith(f"before step 0; {NOT_CONFIRMED}") for answer in answers)
        assert time.monotonic() - begin < 0.2 * 100 * 0.5
