"""What the node of the table driver makes of a word at a bad moment: the node itself, without a middleware."""

import time
from types import SimpleNamespace

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.states import DriveState, NodeState, Outcome
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.safety import Action
from bmd_rths_core.table.models.simulated import SimulatedTable
from bmd_rths_msgs_py.cdr import ScalarCodec
from bmd_rths_msgs_py.topics import COMMAND, NUMERICAL_SUBSTRUCTURE, TABLE_DRIVER
from bmd_rths_nodes.nodes.table_driver import TableDriverNode
from bmd_rths_nodes.ros import status
from bmd_rths_nodes.ros.agreement import Agreement
from bmd_rths_nodes.ros.end_of_test import EndOfTest
from bmd_rths_nodes.ros.intra_process import IntraProcess
from bmd_rths_nodes.ros.status import NodeStatus
from bmd_rths_nodes.ros.step_order import StepOrder

CONFIG = Config()
DT = CONFIG.run.time_step


class Table(SimulatedTable):
    """It notes what it is told."""

    calls: tuple[str, ...] = ()

    def connect(self):
        self.calls += ("connect",)
        super().connect()

    def stop(self):
        self.calls += ("stop",)
        super().stop()

    def emergency_stop(self):
        self.calls += ("emergency_stop",)
        super().emergency_stop()

    def close(self):
        self.calls += ("close",)
        super().close()


class BareNode(TableDriverNode):
    """The node with a driver whose commands are given by hand; what it tells is kept."""

    def __init__(self):
        self.config, self.configured, self.state, self.note = CONFIG, True, NodeState.READY, ""
        self.to_log = []
        parts = (CONFIG.simulated_table, CONFIG.specimen.building(), DT, CONFIG.run.seed)
        self.table = self._table = Table(*parts)
        self._driver = TableDriver(self.table, make_supervisor(CONFIG), DT, False, lambda measurement: None)
        self._forget_the_last_test()
        self._driver.arm()
        self.steps = 0
        self.agreement, self.order = Agreement(TABLE_DRIVER, "process of the driver"), StepOrder(CONFIG.run.stamps)
        self.end_of_test = EndOfTest(recorded=False)
        self._intra_process, self._said = IntraProcess([TABLE_DRIVER]), ""
        self._connections = SimpleNamespace(listen=self._listen)
        self.subscribe_to(COMMAND, self._on_command)

    def _listen(self, topic, on_message, profile):
        self.arrive = on_message

    def status_due_within(self, seconds):
        pass

    def set_state(self, state, note="", level=status.OK):
        self.state, self.note = state, note

    def publish_status(self):
        pass

    def follow(self, commands):
        for command in commands:
            self._on_command(self.steps, command)
            self.steps += 1

    def hear(self, state, **values):
        self.on_peer(NodeStatus("/rths/numerical_substructure", state, values=values))

    def finish(self):
        """Let the table come to rest, faster than the clock."""
        now = time.perf_counter()
        while self._driver.state is DriveState.RETURNING:
            now = max(now + 1e-6, self._driver.poll(now))
        self._tell_changes()


@pytest.fixture
def node():
    return BareNode()


@pytest.mark.parametrize("asked", ["", "emergency_stop"])
def test_end_that_asks_for_an_emergency_stop_overrides_the_way_the_driver_has_begun(node, asked):
    """The stability indicator may pass its limit in the slot in which the driver refuses a command."""
    node.follow([1.0] * 10 + [25.0])
    assert node._driver.state is DriveState.RETURNING
    node.hear(NodeState.ENDED, action=asked)
    assert ("emergency_stop" in node.table.calls) is bool(asked)
    assert node._driver.state is (DriveState.AT_REST if asked else DriveState.RETURNING)
    assert (node.state, node._driver.outcome) == (NodeState.TRIPPED, Outcome.LIMIT)


def test_step_0_of_another_test_does_not_make_the_driver_forget_a_table_that_moves(node):
    """A bag of an earlier test that is played, until it is noticed as a second publisher."""
    node.follow([1.0] * 10)
    motion, calls = node._driver.supervisor.motion, node.table.calls
    node.reset_stage()
    assert node.table.calls == calls
    assert (node.state, node.note) == (NodeState.TRIPPED, "another test begins while the table moves")
    assert node._driver.outcome is Outcome.FAILED
    assert node._driver.supervisor.motion.displacement == pytest.approx(motion.displacement, abs=0.01)
    node._on_command(0, 0.0)
    node.finish()
    assert node._driver.state is DriveState.AT_REST
    assert node._driver.supervisor.stands


def test_stop_on_the_way_to_rest_of_a_test_that_has_ended_is_latched_too(node):
    node.follow([1.0] * 10)
    node.hear(NodeState.ENDED)
    assert (node.state, node._driver.state) == (NodeState.ENDED, DriveState.RETURNING)
    assert node._on_stop() == "the table is on its way to rest already; no test begins before a reset"
    node.finish()
    assert (node.state, node.note) == (NodeState.TRIPPED, "stopped by the operator")
    assert node._on_stop() == "the table is at rest already"


def test_limit_on_the_way_to_rest_of_a_test_that_has_ended_is_latched(node):
    node.follow([1.0] * 10)
    node.hear(NodeState.ENDED)
    broken = node.table.exchange
    node.table.exchange = lambda command: broken(command)._replace(actuator_force=float("nan"))
    node.finish()
    assert node.state is NodeState.TRIPPED
    assert node.note.startswith("safety.non_finite_action: actuator force at step")


def test_ordinary_end_leaves_the_driver_waiting_for_the_next_test(node):
    node.follow([1.0] * 10)
    node.hear(NodeState.ENDED)
    node.finish()
    assert (node.state, node._driver.outcome) == (NodeState.WAITING, None)
    node.hear(NodeState.ENDED, action=Action.EMERGENCY_STOP.name.lower())  # told once a second
    assert "emergency_stop" not in node.table.calls


def test_controller_that_raises_what_it_should_not_is_stopped_and_released_all_the_same(node):
    node.ending = None
    node.follow([1.0] * 10)

    def broken(command):
        raise ValueError("a bug of somebody else")

    node.table.exchange = broken
    with pytest.raises(ValueError, match="a bug of somebody else"):
        node.stop_stage()
    assert node.table.calls[-2:] == ("stop", "close")
    assert node._driver.state is DriveState.RELEASED


# ---- commands of no test


class Loop:
    """What the driver hears of the rest of the loop: the numerical substructure, and whoever sends commands."""

    def __init__(self, node):
        self.node, self.agreement = node, Agreement(NUMERICAL_SUBSTRUCTURE, "process of another node")

    def offer(self):
        self.agreement.begin({})
        self.tell(NodeState.WAITING)

    def tell(self, state, **values):
        values |= self.agreement.identity()
        name = f"/rths/{NUMERICAL_SUBSTRUCTURE}"
        self.node._hear(NodeStatus(name, state, values=values, stamp=time.time()))

    def send(self, step, acceleration=1.0):
        self.node.arrive(ScalarCodec().pack(CONFIG.run.stamps.of(step), acceleration))
        return self.node._driver.state


def test_commands_of_a_lone_publisher_move_nothing(node):
    """A person at the keyboard, or a bag that is played: no test was offered that they could be of."""
    loop = Loop(node)
    assert {loop.send(step) for step in range(5)} == {DriveState.ARMED}
    assert node.to_log == [(status.WARN, "command dropped: numerical_substructure has offered no test it could be of")]
    loop.offer()
    assert loop.send(0) is DriveState.FOLLOWING


def test_commands_that_come_late_after_a_test_that_had_ended_before_the_first_of_them_move_nothing(node):
    """A command shaper that stood still: the deadlines ended the test, and then its commands arrive."""
    loop = Loop(node)
    loop.offer()
    loop.tell(NodeState.RUNNING)
    loop.tell(NodeState.ENDED, outcome="failed")
    assert {loop.send(step) for step in (20, 21, 0, 1)} == {DriveState.ARMED}
    assert node.to_log[1:] == []  # but for how the test has ended
    loop.offer()
    assert loop.send(0) is DriveState.FOLLOWING
    assert node._driver.last_passed == 0


def test_commands_after_a_test_do_not_begin_another_one(node):
    loop = Loop(node)
    loop.offer()
    for step in range(10):
        loop.send(step)
    loop.tell(NodeState.ENDED, outcome="finished")
    node.finish()
    assert {loop.send(step) for step in (10, 0, 1)} == {DriveState.AT_REST}
    loop.offer()
    assert loop.send(0) is DriveState.FOLLOWING


# ---- steps of the next test


@pytest.fixture
def order():
    return StepOrder(CONFIG.run.stamps)


def take(order, *steps, topic="command"):
    taken = [order.take(topic, CONFIG.run.stamps.of(step)) for step in steps]
    return [(one.step, one.begins_anew) if one else None for one in taken]


def test_next_test_begins_also_after_a_test_of_one_step(order):
    assert take(order, 0, 0) == [(0, False), None]  # the second one is the same message
    order.expect_new_test()
    assert take(order, 0, 0, 1) == [(0, True), None, (1, False)]
    assert (order.lost, order.out_of_order) == (0, 2)


def test_next_test_begins_also_where_its_step_0_was_lost(order):
    take(order, *range(10))
    order.expect_new_test()
    assert take(order, 2, 1, 3) == [(2, True), None, (3, False)]
    assert order.lost == 2


def test_each_topic_begins_a_new_test_once(order):
    take(order, 0, 1, 2)
    take(order, 0, topic="other")
    order.expect_new_test()
    assert take(order, 0, 1) == [(0, True), (1, False)]
    assert take(order, 0, 1, topic="other") == [(0, True), (1, False)]
    assert take(order, 5, 0, topic="third") == [(5, False), (0, True)]
