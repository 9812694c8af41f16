"""Run nodes until a signal: the one loop that waits for messages and for the next tick."""

from __future__ import annotations

import gc
import math
import os
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack

import rclpy
from rclpy.exceptions import ROSInterruptException
from rclpy.experimental import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.ros.ending_signals import Ending
from bmd_rths_nodes.ros.executable_help import help_of
from bmd_rths_nodes.ros.intra_process import IntraProcess
from bmd_rths_nodes.ros.middleware import prepare_middleware
from bmd_rths_nodes.ros.parameter_files import refuse_unreached
from bmd_rths_nodes.ros.real_time import enter_real_time
from bmd_rths_nodes.ros.stage_node import StageNode
from bmd_rths_nodes.ros.warm_up import warm_up

#: A wait in the middleware ends up to this late [s]; the rest is waited for by looking at the clock.
WAKE_UP_MARGIN = 0.0003

#: Longest wait in the middleware [s], because signals are seen only between two waits.
LONGEST_WAIT = 0.05

#: Time that housekeeping of a node may take [s]; it is done where so much is left before something is due, ...
HOUSEKEEPING_TIME = 0.002

#: ... just after a message, or where none has come for this long [s], ...
LONGEST_STEP = 0.05

#: ... and in any case after this time [s].
HOUSEKEEPING_PATIENCE = 0.3

#: How often it is looked whether the test is over and the process may end [s].
DONE_PERIOD = 0.5

#: Environment variable with the process id of the parent this process must not outlive.
SUPERVISOR_VARIABLE = "BMD_RTHS_SUPERVISOR"

#: Environment variable: do not enter the ROS domain before this word comes on the standard input.
DOOR_VARIABLE = "BMD_RTHS_DOOR"


def run_nodes(node_types: Sequence[type[StageNode]], arguments: Sequence[str] | None = None) -> int:
    """Run nodes in this process until SIGINT, SIGTERM, or SIGHUP where it is not ignored.

    Parameters
    ----------
    node_types : sequence of type
        The nodes; they share one executor.
    arguments : sequence of str, optional
        Command line with ``--ros-args``; that of the process by default.

    Returns
    -------
    int
        Exit status: 0 after ``--help``, a signal, or when the supervisor does not let it in, 2 when parameters or
        inputs are wrong; with ``exit_when_done`` 0 when the test has finished, and 1 when it has ended in another way.
    """
    given = sys.argv if arguments is None else arguments
    try:
        if text := help_of(node_types, given[1:] if arguments is None else given):
            print(text)
            return 0
    except InputError as error:
        return _refuse(str(error))
    ending = Ending()
    if not _let_in():
        return 0
    try:
        prepare_middleware()
        rclpy.init(
            args=list(arguments) if arguments is not None else None, signal_handler_options=SignalHandlerOptions.NO
        )
    except (InputError, rclpy_implementation.RCLError, ROSInterruptException) as error:
        return _refuse(str(error))
    nodes: list[StageNode] = []
    intra_process = IntraProcess([node_type.ROLE for node_type in node_types])
    executor = EventsExecutor()
    try:
        for node_type in node_types:
            nodes.append(node_type(intra_process))
            executor.add_node(nodes[-1])
        names = [node.get_fully_qualified_name() for node in nodes]
        if len({node.get_namespace() for node in nodes}) > 1:
            return _refuse(f"__ns: the nodes of one process are in one namespace, these are not: {', '.join(names)}")
        refuse_unreached(given, names)
        first = nodes[0]
        if first.in_real_time and (in_force := enter_real_time(first.config.real_time)):
            first.get_logger().info(f"in real time: {', '.join(in_force)}")
        for node in nodes:
            problem = _autostart(node)
            if problem:
                return _refuse(problem)
        warm_up()
        # What lives now lives to the end; the collector need not look at it during a step.
        gc.collect()
        gc.freeze()
        done = _spin(executor, nodes, intra_process, ending)
        return nodes[0].end_of_test.exit_status if done else 0
    except InputError as error:
        return _refuse(str(error))
    finally:
        with ExitStack() as last:  # the last one first, each of them whatever becomes of the others
            last.callback(ending.no_more)
            last.callback(rclpy.try_shutdown)
            last.callback(executor.shutdown)  # it would keep the nodes on the domain for as long as this process lives
            for node in reversed(nodes):
                last.callback(node.destroy_node)
                last.callback(node.flush_log)
                last.callback(node.say_farewell)
            last.callback(intra_process.publish)
            for node in reversed(nodes):  # every one of them before any waits
                last.callback(node.make_safe, ending)
            last.callback(intra_process.publish)  # what led to an end is recorded before the way to rest


def _let_in() -> bool:
    """Wait until the supervisor, if there is one, has looked for another run on the domain; what it takes is loaded."""
    word = os.environ.get(DOOR_VARIABLE)
    return word is None or sys.stdin.readline().strip() == word


def _spin(
    executor: rclpy.executors.Executor, nodes: Sequence[StageNode], intra_process: IntraProcess, ending: Ending
) -> bool:
    """Run the nodes until they are asked to end; return True when they end because the test is over."""
    clock = time.perf_counter
    orphaned_at = math.inf
    done_due = -math.inf
    supervisor = os.environ.get(SUPERVISOR_VARIABLE)
    while True:
        now = clock()
        if supervisor is not None and os.getppid() != int(supervisor):
            orphaned_at = min(orphaned_at, now)
        if ending.asked or orphaned_at < math.inf:
            waited = ending.waited(now) if ending.asked else now - orphaned_at
            if not any(node.wants_more_time(waited, ending.hurried) for node in nodes):
                return False
        if now >= done_due:
            done_due = now + DONE_PERIOD
            if all(node.is_done(now) for node in nodes):
                return True
        due = min(node.poll(now) for node in nodes)
        delivered = intra_process.deliver()
        house = min(nodes, key=lambda node: node.house_due)
        if house.house_due <= now and _leaves_time(now, due, nodes, house.house_due):
            house.keep_house(now)
            continue
        if delivered:
            executor.spin_once(timeout_sec=0.0)  # in lockstep there is always more to deliver
            continue
        if not any(node.drives for node in nodes):
            for node in nodes:
                node.flush_log()
        until = min(due, max(house.house_due, now + HOUSEKEEPING_TIME))
        wait = until - clock()
        if wait > WAKE_UP_MARGIN:
            executor.spin_once(timeout_sec=min(wait - WAKE_UP_MARGIN, LONGEST_WAIT))
        else:  # what has arrived is read up to the last moment, and by a process that is late
            executor.spin_once(timeout_sec=0.0)
            while clock() < until:
                executor.spin_once(timeout_sec=0.0)


def _leaves_time(now: float, due: float, nodes: Sequence[StageNode], house_due: float) -> bool:
    """Tell whether there is time for housekeeping: a message was just handled, or none comes, and nothing is due."""
    since = now - max(node.stepped_at for node in nodes)
    between_steps = since < 0.5 * HOUSEKEEPING_TIME or since > LONGEST_STEP
    return (due - now > HOUSEKEEPING_TIME and between_steps) or now - house_due > HOUSEKEEPING_PATIENCE


def _autostart(node: StageNode) -> str:
    """Configure and activate a node if it wants that, and return what went wrong."""
    if not node.get_parameter("autostart").value:
        return ""
    for transition in (node.trigger_configure, node.trigger_activate):
        if transition() != TransitionCallbackReturn.SUCCESS:
            return node.problem or f"{node.ROLE} could not be started"
    return ""


def _refuse(problem: str) -> int:
    print(f"error: {' '.join(problem.split())}", file=sys.stderr, flush=True)
    return 2
