"""True motion of the virtual tables: what sensors without noise would say, and the derivative of the displacement."""

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.loop.build import make_virtual_controller
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_core.table.udp_controller import make_udp_table
from bmd_rths_core.table.wire import ControllerState
from tests.faults.rig import VirtualNetwork

QUIET = {"simulated_table__acceleration_noise": 0.0, "simulated_table__shear_noise": 0.0} | {
    f"simulated_table__{name}_noise": 0.0 for name in ("displacement", "force")
}


def test_peaks_are_the_largest_absolute_values():
    peaks = TrueMotion()
    for motion in ((1.0, -2.0, 0.0, 5.0), (-3.0, 1.0, 0.5, -4.0)):
        peaks = peaks.peaks(TrueMotion(*motion))
    assert peaks == (3.0, 2.0, 0.5, 5.0)


@pytest.mark.parametrize("model", ["servo", "servo_hydraulic"])
def test_motion_agrees_with_sensors_without_noise_and_velocity_is_the_derivative(model):
    config = Config().changed(virtual_controller__model=model, **QUIET)
    table = make_virtual_controller(config, Faults())._make_table(0.0005)
    motions, displacements = [], []
    for step in range(2000):
        measured = table.exchange(TableCommand(step, np.sin(12.0 * 0.0005 * step)))
        motions.append(table.motion)
        displacements.append(measured.table_displacement)
        assert table.motion.acceleration == measured.table_acceleration
        assert table.motion.force == measured.actuator_force
        assert table.motion.displacement == measured.table_displacement
    derivative = (np.array(displacements)[2:] - np.array(displacements)[:-2]) / 0.001
    assert np.array(motions)[1:-1, 1] == pytest.approx(derivative, abs=1e-5)


@pytest.mark.parametrize("model", ["servo", "servo_hydraulic"])
def test_controller_lets_go_of_a_table_that_really_stands(model):
    """The table lags behind what it is asked for: at rest is where it stands, not where it should."""
    config = Config().changed(virtual_controller__model=model, **QUIET)
    network = VirtualNetwork(config, Faults())
    table, begin = make_udp_table(config, network, session=1), network.now()
    table.connect()
    for step in range(100):
        network.sleep(begin + (step + 1) * config.run.time_step)
        table.exchange(TableCommand(step, 2.0 * np.sin(2 * np.pi * 2.0 * 0.005 * step)))
    controller = network.controller
    assert not controller.at_rest
    assert abs(controller.motion.velocity) > 0.005
    table.stop()
    assert controller.at_rest
    assert controller.state is ControllerState.IDLE
    assert abs(controller.motion.velocity) < 1e-3
    assert controller.peaks.velocity > 0.1
