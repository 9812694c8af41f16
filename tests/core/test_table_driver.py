"""The table driver in an ordinary test: commands reach the table in their own slots, and it ends at rest."""

import numpy as np
import pytest

from bmd_rths_core.loop.states import DriveState, Outcome
from bmd_rths_core.safety import Action
from tests.core.driven_table import ALL, DT, REAL, Asynchronous, Host, assert_at_rest, sine


@pytest.mark.parametrize("kind", ALL)
def test_commands_reach_the_table_and_it_ends_at_rest(kind):
    world = kind()
    host = Host(world)
    commands = sine()
    host.follow(commands)
    assert [a for _, _, a in world.begun] == commands.tolist()
    assert host.driver.last_passed == 99
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert (host.state, host.driver.outcome, host.driver.reason) == (DriveState.AT_REST, None, "")
    assert [m.step for m in host.measured] == list(range(100))
    assert np.diff(world.times) == pytest.approx(DT, abs=1e-9)
    assert world.calls[-1] == "stop"
    assert_at_rest(world)


def test_command_that_leaves_late_is_followed_by_the_next_a_step_later():
    """A host that stands still between its look at the clock and its packet sends no two of them at once."""

    class LeavingLate(Asynchronous):
        def begin(self, command):
            self.lag = 0.0047 if command.step == 102 else 0.0
            return super().begin(command)

    world = LeavingLate()
    host = Host(world)
    host.follow(sine())
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert np.diff(world.times)[101:104] == pytest.approx([DT + 0.0047, DT, DT], abs=1e-9)
    assert_at_rest(world)


@pytest.mark.parametrize("kind", REAL)
def test_refused_command_is_replaced_in_its_own_slot(kind):
    """Braking begins when the refused command would have, and not one step later."""
    world = kind()
    host = Host(world)
    host.follow([1.0] * 10 + [25.0, 1.0])
    host.to_rest()
    assert host.driver.outcome is Outcome.LIMIT
    assert "acceleration_limit" in host.driver.reason
    assert world.steps[:13] == list(range(13))
    assert world.begun[10][2] < 1.0
    assert np.diff(world.times)[:12] == pytest.approx(DT, abs=1e-9)
    assert host.driver.last_passed == 9
    assert_at_rest(world)


@pytest.mark.parametrize("kind", REAL)
@pytest.mark.parametrize("early", [0.1, 0.5, 0.9])
def test_way_to_rest_begins_when_the_last_command_was_held_for_a_step(kind, early):
    world = kind()
    host = Host(world)
    host.follow([1.0] * 10)
    host.driver.command(10, 1.0, world.now)
    host.wait(world.now + early * DT)
    host.driver.finish(Action.RAMP, world.now)
    host.to_rest()
    assert np.diff(world.times) == pytest.approx(DT, abs=1e-9)
    assert_at_rest(world)
