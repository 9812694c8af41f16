"""The loop on one host, table driver and controller on another one, over a cable between two network namespaces."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bmd_rths_core.config import Config, dump_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.ros.middleware import PROFILES, RANGE
from tests.conftest import WITHOUT_LIMITS
from tests.nodes.two_hosts import UNSHARE

#: The loop without its table driver, in one process.
LOOP = (
    "import sys; from bmd_rths_nodes.nodes.composed_loop import LOOP_NODES; "
    "from bmd_rths_nodes.ros.spin import run_nodes; "
    "sys.exit(run_nodes([node for node in LOOP_NODES if node.ROLE != 'table_driver']))"
)


def why_not():
    """Return why this computer has no second network for a test, "" where it has."""
    missing = [tool for tool in ("unshare", "nsenter", "ip") if shutil.which(tool) is None]
    if missing:
        return f"{missing[0]} is not installed"
    cable = ("ip", "link", "add", "here", "type", "veth", "peer", "name", "there")
    tried = subprocess.run([*UNSHARE, *cable], capture_output=True)
    return "" if tried.returncode == 0 else f"no namespaces: {tried.stderr.decode().strip()}"


WHY_NOT = why_not()


@pytest.mark.slow
@pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)
def test_loop_here_and_table_there_in_real_time(tmp_path, monkeypatch):
    """What came before the first missed deadline equals the loop in process, and the closure is in the bag."""
    monkeypatch.setenv(RANGE, "SUBNET")
    monkeypatch.delenv(PROFILES, raising=False)
    config = Config().changed(
        ground_motion__duration=2.0,
        run__longest_miss_time=20.0,
        safety__stale_shear_time=20.0,
        recorder__directory=str(tmp_path / "bags"),
        **WITHOUT_LIMITS,
    )
    (tmp_path / "parameters.yaml").write_text(dump_config(config))
    given = ["--ros-args", "--params-file", str(tmp_path / "parameters.yaml"), "-p", "exit_when_done:=true"]
    node = [sys.executable, "-m", "bmd_rths_nodes.nodes"]
    commands = {
        "here": [[sys.executable, "-c", LOOP, *given], [*node[:-1], f"{node[-1]}.recorder", *given]],
        "there": [[*node[:-1], f"{node[-1]}.table_driver", *given]],
    }
    script = [*UNSHARE, sys.executable, str(Path(__file__).with_name("two_hosts.py")), json.dumps(commands)]
    done = subprocess.run(script, cwd=tmp_path, capture_output=True, text=True, timeout=120.0)
    told = "\n".join(file.read_text() for file in tmp_path.glob("*here_*.txt"))
    assert done.stdout.strip() == "[0, 0, 0]", done.stderr + told
    (bag,) = (tmp_path / "bags").iterdir()
    record = read_bag(bag)
    assert (record.outcome, record.steps) == ("finished", 401)
    expected = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    undisturbed = min(record.timing.missed_steps, default=record.steps)
    for name, values in record.signals().items():
        assert (values[:undisturbed] == expected.signals()[name][:undisturbed]).all(), name
    assert 0.0 < record.timing.closure_ms["p50"] < 1e3 * record.time_step
