"""The table driver and its stop: a test has not finished before the table is known to be at rest."""

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.identification.excited_table import DrivingStopped, drive
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.loop.table_driver import NOT_CONFIRMED
from bmd_rths_core.safety import Action
from bmd_rths_core.table.models.simulated import SimulatedTable
from tests.core.driven_table import DT, Host, Waiting, sine


def unconfirmed_stop(call, step):
    raise OSError("no route to the table")


@pytest.mark.parametrize("confirmed", [True, False])
@pytest.mark.parametrize("steps", [0, 10])
@pytest.mark.parametrize("action", [Action.RAMP, Action.EMERGENCY_STOP])
def test_stop_that_is_not_confirmed_is_a_failure_whatever_ended_the_test(action, steps, confirmed):
    world = Waiting()
    world.stop_confirmed = confirmed
    host = Host(world)
    host.follow([1.0] * steps)
    host.driver.finish(action, world.now)
    host.to_rest()
    driver = host.driver
    assert driver.state is DriveState.AT_REST
    told = (driver.outcome, driver.reason, driver.stop_problem)
    assert told == ((None, "", "") if confirmed else (Outcome.FAILED, NOT_CONFIRMED, NOT_CONFIRMED))


def test_first_reason_stays_beside_a_stop_that_is_not_confirmed():
    world = Waiting()
    world.stop_confirmed = False
    host = Host(world)
    host.follow([1.0] * 10 + [25.0])
    host.to_rest()
    assert host.driver.outcome is Outcome.LIMIT
    assert "acceleration_limit" in host.driver.reason
    assert host.driver.stop_problem == NOT_CONFIRMED


def test_stop_that_raises_is_not_confirmed_and_the_table_is_released(monkeypatch):
    world = Waiting()
    host = Host(world)
    monkeypatch.setattr(world, "stop", lambda: world.fails("stop", -1))
    world.fails = unconfirmed_stop
    host.driver.release()
    assert host.driver.stop_problem == f"{NOT_CONFIRMED}: no route to the table"
    assert (host.driver.outcome, host.driver.state, world.calls[-1]) == (Outcome.FAILED, DriveState.RELEASED, "close")


def test_next_test_begins_without_the_problem_of_the_last():
    world = Waiting()
    world.stop_confirmed = False
    host = Host(world)
    host.driver.halt()
    assert host.driver.stop_problem
    host.driver.arm()
    assert (host.driver.outcome, host.driver.stop_problem) == (None, "")


class SilentAfterTheStop(SimulatedTable):
    """It does all it is told, and does not say that it stands."""

    stop_confirmed = False


def test_test_in_process_has_not_finished_before_its_table_is_known_to_be_at_rest():
    config = Config().changed(ground_motion__duration=0.2)
    motion = select_ground_motion(config.ground_motion, config.run.time_step)
    parts = (config.simulated_table, config.specimen.building(), config.run.time_step, config.run.seed)
    whole = RthsLoop(config, motion, SimulatedTable(*parts)).run()
    record = RthsLoop(config, motion, SilentAfterTheStop(*parts)).run()
    assert (whole.outcome, whole.reason) == ("finished", "end of the ground motion")
    assert (record.outcome, record.reason) == ("failed", f"end of the ground motion; {NOT_CONFIRMED}")
    assert record.same_signals(whole)
    with pytest.raises(DrivingStopped, match=f"{NOT_CONFIRMED}$"):
        drive(SilentAfterTheStop(*parts), make_supervisor(config), sine(), DT)
