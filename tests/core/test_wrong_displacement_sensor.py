"""A displacement sensor with the wrong sign, scale or zero leads no table away: neither on its path nor at its rest."""

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.identification.commissioning import pulse_commands
from bmd_rths_core.identification.excited_table import drive
from bmd_rths_core.loop.build import make_calibration, make_supervisor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.table.emulated.faults import Faults, parse_fault
from bmd_rths_core.table.udp_controller import make_udp_table
from bmd_rths_core.table.wire import ControllerState
from tests.faults.rig import SESSION, VirtualNetwork

CONFIG = Config().changed(
    virtual_controller__model="servo",
    virtual_controller__watchdog=1.0,
    safety__stale_controller_action="ignore",
    run__scheme="uc",
    ground_motion__duration=1.5,
    ground_motion__peak_acceleration=0.5,
)

#: Sensors whose signs are those of the table, and their scales less than twice the right ones.
RIGHT, WRONG = [1.0, 1.5], [-1.0, -0.3, 2.0, 3.0]


def rig(**changes):
    config = CONFIG.changed(**changes)
    faults = Faults([])
    network = VirtualNetwork(config, faults)
    return config, faults, network, make_udp_table(config, network, SESSION)


def after_a_bad_network(scale):
    """Run a test whose lost commands leave the table off zero; return its loop, and where the table was and is then."""
    config, faults, network, table = rig(sensors__table_displacement_scale=scale)
    loop = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step), table, network)
    way, halt, connect = loop.driver._begin_way_to_rest, loop.driver.halt, table.connect
    motions = []

    def begin(now):
        faults.clear("loss")
        motions.append(network.controller.peaks)
        way(now)

    loop.driver._begin_way_to_rest = begin
    loop.driver.halt = lambda: (motions.append(network.controller.motion), halt())
    table.connect = lambda: (connect(), faults.set(parse_fault("loss=30", "servo")))
    loop.run()
    return loop, network.controller, motions[0], motions[1]


@pytest.mark.slow
@pytest.mark.parametrize("scale", [*RIGHT, *WRONG])
def test_table_is_not_led_away_after_a_test(scale):
    loop, controller, before, at_rest = after_a_bad_network(scale)
    told = [] if scale in RIGHT else ["sensors.table_displacement_scale"]
    assert [trip.limit for trip in loop.supervisor.trips] == told
    assert controller.state is ControllerState.IDLE
    assert controller.peaks.displacement < 4.0 * before.displacement
    if scale in RIGHT:
        assert abs(at_rest.displacement) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("scale", [-1.0, -0.3, 3.0])
def test_pulses_that_are_to_find_a_wrong_sensor_stay_as_small_as_they_are(scale):
    config, _, network, table = rig(sensors__table_displacement_scale=scale)
    commands, step = pulse_commands(config)[700:1700], config.run.time_step
    drive(table, make_supervisor(config), commands, step, clock=network, calibration=make_calibration(config))
    asked = np.abs(np.cumsum(np.cumsum(commands))).max() * step**2
    assert network.controller.peaks.displacement < asked + 1.5 * config.safety.following_tolerance


def test_zero_of_a_sensor_does_not_lead_the_table_there():
    """A table whose sensor reads 0.1 m where it stands is not moved by 0.1 m."""
    config, _, network, table = rig(sensors__table_displacement_offset=-0.1)
    commands, step = np.zeros(400), config.run.time_step
    commands[::2] = 0.1
    commands[1::2] = -0.1
    drive(table, make_supervisor(config), commands, step, clock=network, calibration=make_calibration(config))
    assert network.controller.peaks.displacement < 1.5 * config.safety.following_tolerance
