"""A way back that a busy computer has made worse is tried once more, more gently: its sensor is not to blame yet."""

import pytest

from bmd_rths_core.config import SafetyConfig
from bmd_rths_core.safety.commanded_motion import Motion
from bmd_rths_core.safety.ramp import ramp_commands
from bmd_rths_core.safety.way_to_rest import WayToRest

DT = 0.005


def corrected(*seen):
    """Watch a table end at these displacements [m], one after the other; return the way and its largest commands."""
    way = WayToRest(SafetyConfig(), DT)
    way._settling.found = iter(Motion(x, 0.0, 0.0) for x in seen).__next__
    largest = []
    for _ in seen:
        way.watches(1)
        found = way.found()
        if found is None:
            break
        commands = [way.correct(found, ramp_commands)]
        while (command := way._pop()) is not None:
            commands.append(command)
        largest.append(max(map(abs, commands)))
    return way, largest


def test_it_is_tried_again_with_a_gentler_way():
    way, (first, second, third) = corrected(0.008, 0.009, 0.006)
    assert way.led_away is None
    assert second == pytest.approx(0.1 * first, rel=0.1)
    assert third == pytest.approx(first, rel=0.2)


def test_what_grows_under_the_gentler_way_too_is_the_sensor():
    way, largest = corrected(0.006, 0.008, 0.009, 0.001)
    assert [motion.displacement for motion in way.led_away] == [0.008, 0.009]
    assert len(largest) == 2


def test_what_no_busy_computer_leaves_is_the_sensor_at_once():
    way, largest = corrected(0.015, 0.03)
    assert way.led_away is not None
    assert len(largest) == 1
