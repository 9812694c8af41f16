"""The end of a test on UDP: a stop that is not confirmed, and a controller that is stopped by another program."""

import json

import numpy as np
import pytest

from bmd_rths_core.identification.excited_table import DrivingStopped, drive
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.loop.table_driver import NOT_CONFIRMED
from bmd_rths_core.table.wire import ControllerState, Kind
from tests.nodes.conftest import CONFIG, processes_of_domain, wait_until
from tests.nodes.scripted_controller import REAL_TIME, Script, answer_to


def test_controller_that_never_leaves_stopping_has_not_confirmed_the_stop(scripted):
    config = REAL_TIME.changed(table__stop_timeout=0.05, run__lockstep=True, table__resend_after=0.01)
    table, script = scripted(lambda p: [answer_to(p)], config)
    script.after_stop = ControllerState.STOPPING
    with pytest.raises(DrivingStopped, match=NOT_CONFIRMED):
        drive(table, make_supervisor(config), np.zeros(5), config.run.time_step)
    assert not table.stop_confirmed
    script.after_stop = script.state = ControllerState.IDLE
    assert drive(table, make_supervisor(config), np.zeros(5), config.run.time_step).source == "driven"
    assert table.stop_confirmed


@pytest.mark.slow
def test_run_whose_controller_never_leaves_stopping_has_failed(bmd_rths, tmp_path):
    script = Script(lambda packet: [answer_to(packet)])
    script.after_stop = ControllerState.STOPPING
    try:
        address = f"udp://127.0.0.1:{script.socket.getsockname()[1]}"
        changes = {"run.preflight": "skip", "ground_motion.duration": 0.2, "table.stop_timeout": 0.5}
        settings = [word for name, value in changes.items() for word in ("--set", f"{name}={value}")]
        options = ("--lockstep", "--composed", "--output", tmp_path / "bags", "--json")
        result = bmd_rths("run", CONFIG, "--table", address, *settings, *options).wait()
    finally:
        script.close()
    assert (result.status, "Traceback" in result.errors) == (1, False), result.errors
    told = json.loads(result.output)
    assert (told["outcome"], told["stability"], told["steps"]) == ("failed", "failed", 41)
    assert told["reason"].startswith("end of the ground motion")
    assert told["reason"].count(NOT_CONFIRMED) == 1
    analysed = bmd_rths("analyze", told["bag"]).wait()
    assert NOT_CONFIRMED in analysed.output


@pytest.mark.slow
@pytest.mark.parametrize("options", [(), ("--composed",)], ids=["five processes", "composed"])
def test_controller_that_is_idle_while_armed_ends_a_run_with_its_own_reason(bmd_rths, tmp_path, domain, options):
    """Before the test begins: another program stops the controller while the nodes look for each other."""
    script = Script(lambda packet: [])
    try:
        address = f"udp://127.0.0.1:{script.socket.getsockname()[1]}"
        settings = ("--set", "run.preflight=skip", "--set", "run.settling_time=8.0", *options)
        child = bmd_rths("run", CONFIG, "--table", address, *settings, "--output", tmp_path / "bags")
        wait_until(lambda: script.received[Kind.ARM])
        script.state = ControllerState.IDLE
        result = child.wait()
    finally:
        script.close()
    assert result.status == 1
    told = result.output + result.errors  # composed nodes find each other so soon that there may be a bag by then
    assert f"table_driver: table controller: {address} is idle: it was stopped or restarted" in told
    assert "did not find each other" not in told
    assert processes_of_domain(domain) == {}
