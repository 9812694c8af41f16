"""The order of the loop stands in one place: whoever hosts it fails alike when two of its calls are swapped."""

import ast
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.identification import excited_table
from bmd_rths_core.loop import rths_loop, table_driver
from bmd_rths_core.loop.build import make_supervisor, make_table_controller
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.udp_controller import make_udp_table
from bmd_rths_nodes.nodes import table_driver as node
from tests.faults.rig import SESSION, Rig, Trial, VirtualNetwork

ROOT = Path(__file__).parents[2]
PACKAGES = ("bmd_rths_core", "bmd_rths_msgs_py", "bmd_rths_nodes")
CONFIG = Config().changed(ground_motion__duration=1.0)

#: Where a command reaches a table, or a supervisor is asked, besides the table driver: layers of the same table.
ELSEWHERE = {
    ("bmd_rths_core/safety/way_to_rest.py", "observe"),  # of the table that should be at rest
    ("bmd_rths_core/parameters.py", "check"),  # of a parameter
    ("bmd_rths_core/safety/supervisor.py", "observe"),  # of what watches how the table follows
    ("bmd_rths_core/table/emulated/virtual_controller.py", "exchange"),
    ("bmd_rths_core/table/emulated/virtual_table.py", "exchange"),
    ("bmd_rths_core/table/udp_controller.py", "begin"),
    ("bmd_rths_nodes/ros/stage_node.py", "begin"),  # of what the nodes agree on
}

#: The place, and what it calls.
DRIVER = "bmd_rths_core/loop/table_driver.py"
CALLS = ("check", "exchange", "begin", "observe")


def calls():
    """Return module and method of every call of the loop in the three packages."""
    found = set()
    for package in PACKAGES:
        for path in (ROOT / package / package).rglob("*.py"):
            for called in ast.walk(ast.parse(path.read_text("utf-8"))):
                if (
                    isinstance(called, ast.Call)
                    and isinstance(called.func, ast.Attribute)
                    and called.func.attr in CALLS
                ):
                    found.add((path.relative_to(ROOT / package).as_posix(), called.func.attr))
    return found


@pytest.mark.slow
def test_nobody_else_moves_a_table_or_asks_the_supervisor():
    assert calls() == ELSEWHERE | {(DRIVER, name) for name in CALLS}


def in_lockstep():
    RthsLoop(CONFIG, select_ground_motion(CONFIG.ground_motion, CONFIG.run.time_step)).run()


def by_a_clock():
    network = VirtualNetwork(CONFIG, Faults([]))
    table = make_udp_table(CONFIG, network, SESSION)
    RthsLoop(CONFIG, select_ground_motion(CONFIG.ground_motion, CONFIG.run.time_step), table, network).run()


def identification():
    time_step = CONFIG.run.time_step
    excited_table.drive(make_table_controller(CONFIG), make_supervisor(CONFIG), np.full(20, 0.1), time_step)


def fault_rig():
    Rig(Trial("none", CONFIG, 0)).run()


HOSTS = [in_lockstep, by_a_clock, identification, fault_rig]


class Swapped(Exception):
    """The supervisor was asked in the wrong order."""


def watched(monkeypatch):
    """Let every supervisor insist that a command is checked before it is sent, and what was sent is observed last."""
    cls = table_driver.SafetySupervisor
    check, observe = cls.check, cls.observe

    def checked(self, step, *arguments):
        self.checked = step
        return check(self, step, *arguments)

    def observed(self, measurement):
        if measurement.step > getattr(self, "checked", -1) and self.passing:
            raise Swapped(f"step {measurement.step} was measured before its command was checked")
        return observe(self, measurement)

    monkeypatch.setattr(cls, "check", checked)
    monkeypatch.setattr(cls, "observe", observed)


@pytest.mark.parametrize("host", HOSTS)
def test_hosts_keep_the_order(host, monkeypatch):
    watched(monkeypatch)
    host()


@pytest.mark.parametrize("host", HOSTS)
def test_swap_of_two_calls_makes_every_host_fail_alike(host, monkeypatch):
    """A driver whose commands are sent first and checked then."""
    source = Path(table_driver.__file__).read_text("utf-8")
    begin = source.index("        if self.supervisor.check(step")
    end = source.index("    def finish(")
    swapped = (
        source[:begin]
        + "        self._exchange(TableCommand(step, acceleration), now)\n"
        + "        if self._polled is not None:\n"
        + "            while self._polled.awaiting:\n"
        + "                if (measurement := self._polled.poll()) is not None:\n"
        + "                    self._observe(measurement)\n"
        + "                self._polled._transport.sleep(self._polled._transport.now() + 0.001)\n"
        + "        self.supervisor.check(step, acceleration)\n"
        + "        self.last_passed = step\n\n"
        + source[end:]
    )
    names = {"__name__": "swapped"}
    exec(compile(swapped, "swapped", "exec"), names)
    watched(monkeypatch)
    for name, method in vars(names["TableDriver"]).items():
        if callable(method) and not name.startswith("__"):
            monkeypatch.setattr(table_driver.TableDriver, name, method)
    with pytest.raises(Swapped, match="step 0 was measured before"):
        host()


def test_all_hosts_have_the_same_driver():
    classes = {module.TableDriver for module in (table_driver, rths_loop, excited_table, node)}
    assert classes == {table_driver.TableDriver}
