"""What every table controller must do: simulated, udp with the emulator, and the example of the documentation."""

import re
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.table.controller import AsynchronousTableController, TableCommand
from bmd_rths_nodes.hardware import controllers
from bmd_rths_nodes.hardware.controllers import make_table_controller
from tests.nodes.emulation import LOCKSTEP, emulator

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "write_a_table_controller.md"
FLOORS = len(Config().specimen.masses)
#: Five times the largest noise of the simulated accelerometers.
NOISE = 5 * Config().simulated_table.acceleration_noise


def documented_controller():
    """Return the class that the documentation shows."""
    block = re.search(r"```python\n(import numpy.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
    assert len(block.splitlines()) <= 40
    namespace = {}
    exec(block, namespace)
    return namespace["RigidTable"]


@pytest.fixture(params=["simulated", "udp", "documented"])
def table(request):
    if request.param == "udp":
        with emulator() as (_, config):
            made = make_table_controller(config)
            yield made
            made.close()
    elif request.param == "simulated":
        yield make_table_controller(Config())
    else:
        yield documented_controller()(Config())


def drive(table, commands, steps=None):
    return [table.exchange(TableCommand(k, commands[k])) for k in steps or range(len(commands))]


def same(one, other):
    return one[:6] == other[:6] and np.array_equal(one.floor_accelerations, other.floor_accelerations)


def test_sensors_at_rest_say_rest(table):
    table.connect()
    for step, m in enumerate(drive(table, [0.0] * 5)):
        assert m.step == step
        assert m.applied_command == 0.0
        assert m.table_displacement == pytest.approx(0.0, abs=5e-4)  # ten times the noise of its sensor
        assert m.table_acceleration == pytest.approx(0.0, abs=NOISE)
        assert m.floor_accelerations == pytest.approx(np.zeros(FLOORS), abs=NOISE)
        assert m.floor_accelerations.shape == (FLOORS,)


def test_applied_command_is_the_command_and_the_table_moves(table):
    table.connect()
    commands = [0.1 * k for k in range(40)]
    measurements = drive(table, commands)
    assert [m.applied_command for m in measurements] == commands
    assert measurements[-1].table_displacement > 0.001
    assert measurements[-1].table_acceleration > 1.0


def test_skipped_steps_hold_the_last_command(table):
    commands = [1.0, -0.5, -0.5, -0.5, 0.3]
    table.connect()
    every = drive(table, commands)
    table.connect()
    received = drive(table, commands, steps=(0, 1, 4))
    assert same(received[-1], every[-1])


def test_step_that_has_passed_is_refused(table):
    table.connect()
    drive(table, [0.0, 0.0])
    with pytest.raises(RuntimeError, match="command of step 1 refused"):
        table.exchange(TableCommand(1, 0.0))


@pytest.mark.parametrize("end", ["stop", "close"])
def test_after_the_end_commands_are_refused_and_a_new_test_begins_at_rest(table, end):
    commands = [1.0, 2.0, 3.0]
    table.connect()
    first = drive(table, commands)
    for _ in range(2):
        getattr(table, end)()
        with pytest.raises(RuntimeError, match="command of step 3 refused"):
            table.exchange(TableCommand(3, 1.0))
    table.connect()
    assert all(same(one, other) for one, other in zip(first, drive(table, commands), strict=True))


def test_connect_in_the_middle_of_a_test_begins_a_new_one(table):
    commands = [1.0, 2.0, 3.0]
    table.connect()
    first = drive(table, commands)
    table.connect()
    assert all(same(one, other) for one, other in zip(first, drive(table, commands), strict=True))


def test_everything_that_ends_a_test_may_be_called_before_it_and_twice(table):
    for end in (table.stop, table.close, table.emergency_stop, table.close):
        end()
        end()
    table.connect()
    drive(table, [0.5])
    table.emergency_stop()
    table.emergency_stop()
    with pytest.raises(RuntimeError, match="refused"):
        table.exchange(TableCommand(1, 0.0))
    table.close()


def test_statistics_are_texts(table):
    table.connect()
    assert all(isinstance(key, str) and isinstance(value, str) for key, value in table.statistics().items())


def test_only_a_controller_that_can_poll_is_used_without_waiting():
    waiting = [make_table_controller(Config()), documented_controller()(Config())]
    assert not any(isinstance(table, AsynchronousTableController) for table in waiting)
    assert isinstance(make_table_controller(LOCKSTEP), AsynchronousTableController)


# ---- which one


class Installed:
    """An entry point of somebody else's package."""

    def __init__(self, name, maker):
        self.name, self.value, self._maker = name, f"their_package:{name}", maker

    def load(self):
        if isinstance(self._maker, Exception):
            raise self._maker
        return self._maker


@pytest.fixture
def installed(monkeypatch):
    found = [
        Installed("rigid", documented_controller()),
        Installed("broken", ImportError("No module\nnamed 'vendor'")),
        Installed("udp", None),
    ]
    monkeypatch.setattr(controllers, "entry_points", lambda group: found if group == controllers.GROUP else [])


def test_installed_controller_is_found_by_its_name(installed):
    made = make_table_controller(Config().changed(table__controller="rigid"))
    made.connect()
    assert made.exchange(TableCommand(0, 2.0)).table_acceleration == 2.0


def test_own_controllers_are_not_replaced(installed):
    assert make_table_controller(LOCKSTEP).statistics()["udp_sent"] == "0"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("rigit", "table.controller: 'rigit' is not available; one of simulated, udp, broken, rigid is required"),
        ("broken", "table.controller: 'broken' (their_package:broken) cannot be loaded: No module named 'vendor'"),
    ],
)
def test_controller_that_is_not_there_or_broken_is_refused_with_one_line(installed, name, message):
    with pytest.raises(InputError) as error:
        make_table_controller(Config().changed(table__controller=name))
    assert str(error.value) == message


def test_udp_needs_an_answer_time_out_below_the_time_step():
    config = Config().changed(table__controller="udp", table__answer_timeout=0.005)
    with pytest.raises(InputError, match=r"table\.answer_timeout: 0\.005 s is not allowed; less than run\.time_step"):
        make_table_controller(config)


@pytest.mark.parametrize("address", ["udp://127.0.0.1", "127.0.0.1:5000", "udp://:5000", "udp://a:0", "udp://a:65536"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(InputError) as error:
        Config().changed(table__address=address)
    assert f"table.address: '{address}' is not allowed; udp://HOST:PORT" in str(error.value)
