"""By the clock, at the far end of the wire: when commands arrive at a controller on UDP, and where they lead a table.

Every test runs the product as a person starts it, in real time, against a controller in this process that notes when
the kernel got each packet. On a busy machine commands come late; the table has to end at rest all the same.
"""

import json
import os
import re
import signal
import time

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.table.wire import Kind
from tests.clock.arrivals import ArrivalController, held, periods
from tests.nodes.conftest import CONFIG, processes_of_domain, wait_until

pytestmark = pytest.mark.slow

DT = Config().run.time_step

#: The rigid table of the controller follows at once: without compensation the loop is stable on it.
RUN = ("--scheme", "uc", "--json")

#: Limits that a machine busy with other tests does not pass by being late.
PATIENT = (
    "run.preflight=skip",
    "run.longest_miss_time=2.0",
    "safety.stale_shear_time=0.5",
    "safety.stale_controller_time=2.0",
)


def settings(*pairs):
    return [word for pair in (*PATIENT, "run.settling_time=0.0", *pairs) for word in ("--set", pair)]


def run(bmd_rths, controller, *arguments, set_=(), duration=2.0):
    """Start a test against the controller."""
    pairs = (f"ground_motion.duration={duration}", *set_)
    return bmd_rths("run", CONFIG, "--table", controller.address, *RUN, *settings(*pairs), *arguments)


def stall(domain, name, seconds):
    """Give a process no processor time for some time."""
    (pid,) = (pid for pid, command in processes_of_domain(domain).items() if f"nodes.{name}" in command)
    os.kill(pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(pid, signal.SIGCONT)


def at_rest(controller, stalls=0):
    """Check where the commands, each held until the next one arrived, have led the table; return its motion.

    The machine may be busy, and hold the host up besides the stalls of a test; how long it did is seen in the commands.
    """
    motion = ends_at_rest(controller, stalls)
    longest = held_up(controller, stalls)
    assert (
        motion.largest_displacement < Config().safety.displacement_limit + max(0.02, longest) * motion.largest_velocity
    )
    assert motion.largest_velocity < Config().safety.velocity_limit
    return motion


def ends_at_rest(controller, stalls):
    """Check that the table stands at zero.

    A host that is held up between its look at the clock and the packet cannot know how long the command before was
    really held: with some 0.05 m/s² between the two a velocity is left that moves the table until the end.
    """
    motion = held(controller.commands)
    unknown = max(0.0, held_up(controller, stalls) - 2.0 * DT)
    duration = controller.commands[-1].time - controller.commands[0].time
    assert abs(motion.velocity) < 1e-3 + 0.05 * unknown
    assert abs(motion.displacement) < 1e-3 + (abs(motion.velocity) * duration if unknown else 0.0)
    return motion


def held_up(controller, stalls):
    """Return how long the machine has held the host up at most, besides the stalls of a test [s]."""
    return np.sort(periods(controller.commands))[-1 - stalls]


def keeps_the_time_step(commands, late_ticks):
    """Check the time between commands; where the machine is too busy for it, the run has counted that."""
    median = np.median(periods(commands))
    assert median > 0.9 * DT
    assert median < 1.1 * DT or late_ticks > 0.25 * len(commands)


def never_in_bursts(controller, steps):
    """Check that the commands of the way to rest did not come together."""
    way = [arrival for arrival in controller.commands if arrival.step >= steps]
    assert len(way) > 10
    assert kept_apart(way)


def kept_apart(commands):
    """Tell whether no commands came together, but for one or two.

    What the host cannot know is that a busy machine holds it up between its look at the clock and the packet.
    """
    return np.sort(periods(commands))[2] > 0.1 * DT


@pytest.mark.parametrize(
    ("mode", "answer_after"),
    [(("--composed",), lambda step: 0.5e-3 if step < 200 else 4e-3), ((), lambda step: 0.5e-3)],
    ids=["composed, 0.5 ms and 4 ms", "five processes, 0.5 ms"],
)
def test_ordinary_end(bmd_rths, mode, answer_after):
    with ArrivalController(answer_after) as controller:
        result = run(bmd_rths, controller, *mode).wait()
        assert result.status == 0, result.errors
        told = json.loads(result.output)
        assert told["outcome"] == "finished"
        at_rest(controller)
        never_in_bursts(controller, told["steps"])
        test = [arrival for arrival in controller.commands if arrival.step < told["steps"]]
        for part in (test[:200], test[200:]):
            keeps_the_time_step(part, told["late_ticks"])
        steps = [arrival.step for arrival in controller.commands]
        assert steps == sorted(set(steps))
        assert [a.kind for a in controller.arrivals if a.kind in (Kind.STOP, Kind.EMERGENCY_STOP)] == [Kind.STOP]


def stopped(child, controller, stalls=0):
    """Check what a test that Ctrl-C has ended tells, and that it has left the table at rest."""
    result = child.wait()
    assert result.status == 1, result.errors
    assert "Traceback" not in result.errors
    told = json.loads(result.output)
    assert told["outcome"] == "stopped"
    assert at_rest(controller, stalls).largest_displacement > 1e-3
    never_in_bursts(controller, told["steps"])


def test_ctrl_c(bmd_rths, domain):
    with ArrivalController(2e-3) as controller:
        child = run(bmd_rths, controller, duration=15.0)
        wait_until(lambda: len(controller.commands) > 300)
        child.interrupt()
        stopped(child, controller)
        assert processes_of_domain(domain) == {}


def test_ctrl_c_and_a_stall_on_the_way_to_rest(bmd_rths, domain):
    """What the table did meanwhile is planned for anew, and not caught up with in a burst."""
    with ArrivalController(2e-3) as controller:
        child = run(bmd_rths, controller, "--composed", duration=15.0, set_=("safety.ramp_velocity=0.02",))
        wait_until(lambda: len(controller.commands) > 300)
        child.interrupt()
        child.wait_for_words("stopping")
        time.sleep(0.1)
        stall(domain, "composed_loop", 0.4)
        stopped(child, controller, stalls=1)
        assert periods(controller.commands).max() > 0.9 * 0.4


@pytest.mark.parametrize(
    ("limit", "floor_gain", "told"),
    [
        ("safety.acceleration_limit=0.8", 1.0, "safety.acceleration_limit [m/s2] passed"),
        ("safety.stability_limit=0.1", 20.0, "safety.stability_limit [1] passed"),
    ],
)
def test_trip(bmd_rths, limit, floor_gain, told):
    """In the driver, where braking begins in the place of the refused command, and in the numerical substructure."""
    with ArrivalController(2e-3, floor_gain=floor_gain) as controller:
        result = run(bmd_rths, controller, "--composed", set_=(limit,), duration=5.0).wait()
        assert result.status == 1, result.errors
        outcome = json.loads(result.output)
        assert outcome["outcome"] == "limit"
        assert told in outcome["reason"]
        at_rest(controller)
        never_in_bursts(controller, outcome["steps"])
        if floor_gain == 1.0:  # the first command on the way to rest has the step of the refused one
            assert outcome["steps"] - 1 in [arrival.step for arrival in controller.commands]


@pytest.mark.parametrize("mode", [("--composed",), ()], ids=["composed", "five processes"])
def test_stalls_of_the_process_that_drives_the_table(bmd_rths, domain, mode):
    """One that the test survives, and one that ends it.

    The last command is held meanwhile: the table ends at rest only if that time is counted. A busy machine may make the
    first one so long that it ends the test.
    """
    name = "composed_loop" if mode else "table_driver"
    with ArrivalController(2e-3) as controller:
        child = run(bmd_rths, controller, *mode, duration=4.0, set_=("safety.stale_shear_time=0.1",))
        wait_until(lambda: len(controller.commands) > 300)
        stall(domain, name, 0.05)
        begun = len(controller.commands)
        wait_until(lambda: len(controller.commands) > begun + 40 or child.process.poll() is not None)
        longest = 0.05
        if child.process.poll() is None and not ended(controller):
            stall(domain, name, 0.3)
            longest = 0.3
        told = json.loads(child.wait().output)
        ends_at_rest(controller, stalls=2)
        assert periods(controller.commands).max() > 0.9 * longest
        never_in_bursts(controller, told["steps"])


def ended(controller):
    """Tell whether the way to rest is over."""
    return any(arrival.kind is Kind.STOP for arrival in controller.arrivals)


def test_other_processes_stall_and_the_driver_brings_the_table_to_rest_in_time(bmd_rths, domain):
    """No command comes any more: the way to rest begins before the limits could no longer be kept."""
    with ArrivalController(2e-3) as controller:
        child = run(bmd_rths, controller, duration=15.0, set_=("safety.stale_shear_time=5.0",))
        wait_until(lambda: len(controller.commands) > 300 and abs(controller.commands[-1].acceleration) > 1.0)
        (pid,) = (pid for pid, command in processes_of_domain(domain).items() if "numerical_substructure" in command)
        os.kill(pid, signal.SIGSTOP)
        try:
            wait_until(lambda: ended(controller))
        finally:
            os.kill(pid, signal.SIGCONT)
        child.wait()
        at_rest(controller)


IDENTIFY = ("--what", "table", "--order", 1, "--band", 1, 20, "--duration", 20, "--json")


@pytest.mark.long
def test_identify_keeps_the_time_step_and_leaves_lost_answers_out(bmd_rths):
    with ArrivalController(2e-3, lost=lambda step: 300 <= step < 303) as controller:
        result = bmd_rths("identify", CONFIG, "--table", controller.address, *IDENTIFY, *settings()).wait()
        assert result.status == 0, result.errors
        source = json.loads(result.output)["source"]
        steps, last = re.search(r"3 of (\d+) steps were not answered in time, used are 303 to (\d+)", source).groups()
        assert int(last) == int(steps) - 1 > 4000
        assert np.median(periods(controller.commands)) > 0.95 * DT
        at_rest(controller)
        assert kept_apart(controller.commands)


@pytest.mark.parametrize("ending", ["lost answers", "ctrl-c"])
def test_identify_that_ends_early_ramps_to_rest_and_says_why_in_one_line(bmd_rths, ending):
    lost = (lambda step: step >= 600) if ending == "lost answers" else (lambda step: False)
    with ArrivalController(2e-3, lost=lost) as controller:
        given = settings("safety.stale_controller_time=0.05") if ending == "lost answers" else settings()
        child = bmd_rths("identify", CONFIG, "--table", controller.address, *IDENTIFY, *given)
        if ending == "ctrl-c":
            wait_until(lambda: len(controller.commands) > 600)
            child.interrupt()
        result = child.wait()
        assert result.status == 1
        assert "Traceback" not in result.errors
        last = result.errors.strip().splitlines()[-1]
        assert ("stale_controller" if ending == "lost answers" else "stopped by the operator") in last
        at_rest(controller)
        assert any(arrival.kind is Kind.STOP for arrival in controller.arrivals)
