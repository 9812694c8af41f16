"""Table driver in real time with a controller whose answers are late or missing."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped
from rclpy.qos import QoSProfile
from trajectory_msgs.msg import JointTrajectory

from bmd_rths_core.table.wire import Kind
from tests.nodes.conftest import Substructure, wait_until
from tests.nodes.scripted_controller import Script, answer_to

TIME_STEP_NS = 100_000_000


class Driver:
    """The node in a process of its own, seen from ROS; a script is its controller."""

    def __init__(self, ros, start, on_command, **settings):
        self.measured, self.told, self.step = [], {}, 0
        self._client = ros
        self.script = Script(on_command)
        ros.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QoSProfile(depth=10))
        ros.create_subscription(JointTrajectory, "/rths/measurement", self._on_measurement, QoSProfile(depth=100))
        self._commands = ros.create_publisher(AccelStamped, "/rths/command", QoSProfile(depth=10))
        settings = {
            "run.record": "false",
            "run.time_step": "0.1",
            "table.controller": "udp",
            "table.address": f"udp://127.0.0.1:{self.script.socket.getsockname()[1]}",
            "table.answer_timeout": "0.09",
            "safety.stale_shear_time": "500",
            **settings,
        }
        parameters = [argument for name, value in settings.items() for argument in ("-p", f"{name}:={value}")]
        self._node = start("-m", "bmd_rths_nodes.nodes.table_driver", "--ros-args", *parameters)
        Substructure(ros).offer(lambda: self.told.get("run"))

    def spin(self):
        self._client.spin_some()

    def send(self):
        """Send the next command until the controller has it; a repeated message is dropped by the driver."""
        received = self.script.received[Kind.COMMAND]
        message = AccelStamped()
        stamp = TIME_STEP_NS * self.step
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        self.step += 1
        return wait_until(
            lambda: (
                self._commands.publish(message)
                or self.spin()
                or self.script.received[Kind.COMMAND] > received
                or self.tripped
            )
        )

    @property
    def tripped(self):
        return self.told.get("state") == "tripped"

    def _on_diagnostics(self, message):
        for entry in message.status:
            if entry.name == "/rths/table_driver":
                self.told = {pair.key: pair.value for pair in entry.values} | {"message": entry.message}

    def _on_measurement(self, message):
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        self.measured.append(stamp // TIME_STEP_NS)

    def close(self):
        self._node.interrupt()
        result = self._node.wait(20.0)
        self.script.close()
        assert (result.status, "Traceback" in result.errors) == (0, False)


@pytest.fixture
def driver(client, start):
    """Start a table driver with a function that answers its commands."""
    made = []

    def make(on_command, **settings):
        made.append(Driver(client, start, on_command, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.mark.slow
def test_newer_commands_reach_the_table_while_an_answer_is_missing(driver):
    """Each answer comes after the next command, which a driver that waits would never send in time."""
    waiting = []

    def one_step_late(packet):
        waiting.append(packet)
        return [answer_to(waiting[-2], step=packet.step)] if len(waiting) > 1 else []

    table = driver(one_step_late, **{"safety.stale_controller_time": "500"})
    wait_until(lambda: table.send() and len(table.measured) >= 3)
    assert table.measured == sorted(set(table.measured))
    assert not table.tripped


@pytest.mark.slow
def test_controller_that_falls_silent_trips_the_driver(driver):
    table = driver(
        lambda packet: [answer_to(packet)] if packet.step < 2 else [], **{"safety.stale_controller_time": "0.3"}
    )
    wait_until(lambda: table.send() and table.tripped)
    assert "safety.stale_controller_time [s] passed at step" in table.told["message"]
    assert table.told["outcome"] == "limit"
    assert max(table.measured, default=0) < 2
    assert int(table.told["udp_lost"]) > 0
    wait_until(lambda: table.spin() or table.told["table"] == "at rest")
    assert table.script.received[Kind.EMERGENCY_STOP] > 0
