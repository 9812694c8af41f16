"""Sub-steps on ROS: the same bits however the targets are computed, and the end of a test whose integration is late."""

import json
import os
import re
import select
import time
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.config import Config, config_from_mapping, dump_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_numerical_stage
from bmd_rths_core.loop.substepped_stage import IntegrationLate
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.hardware.integration_process import IntegrationProcess
from tests.clock.arrivals import ArrivalController
from tests.nodes import slow_integration
from tests.nodes.conftest import CONFIG
from tests.nodes.test_by_the_clock import PATIENT, at_rest, never_in_bursts

ROOT = Path(__file__).parents[2]

#: A soft story, so that four steps are still short beside its period.
SOFT = {
    "numerical_substructure__stiffnesses": [3e6],
    "numerical_substructure__substeps": 4,
    "force_correction__feedback_scale": 0.3,
}
STEPPED = Config().changed(**SOFT)


@pytest.fixture
def slow(monkeypatch):
    """Return a function that makes the process of slow integrations."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")]))))
    made = []

    def make(pairs):
        monkeypatch.setenv(slow_integration.VARIABLE, pairs)
        made.append(IntegrationProcess(STEPPED, slow_integration.__name__))
        return made[-1]

    yield make
    for process in made:
        process.close()


def loads(steps=60):
    random = np.random.default_rng(2)
    return random.normal(size=steps), 1e3 * random.normal(size=steps)


# ---- the process


def test_a_configuration_is_told_without_loss():
    assert config_from_mapping(json.loads(json.dumps(STEPPED.as_mapping()))) == STEPPED


@pytest.mark.parametrize(
    "changes", [{}, {"nonlinear__story_model": "bilinear", "nonlinear__yield_drifts": [1e-3],
                     "nonlinear__integration": "cr"}], ids=["exact", "yielding"]
)  # fmt: skip
@pytest.mark.slow
def test_another_process_leads_to_the_same_bits_test_after_test(changes):
    config = STEPPED.changed(**changes)
    ground, shear = loads()
    process = IntegrationProcess(config)
    try:
        beside, at_once = make_numerical_stage(config, ground, process), make_numerical_stage(config, ground)
        for steps in (41, 60):  # the first test ends while a target is computed
            beside.reset()
            at_once.reset()
            for k in range(steps):
                if k % 4 == 3:  # the next one takes the target; a busy machine may need long for it
                    assert select.select([process._output], [], [], 10.0)[0]
                assert beside.step(ground[k], shear[k]) == at_once.step(ground[k], shear[k])
                assert (beside.displacements == at_once.displacements).all()
                assert (beside.velocities == at_once.velocities).all()
        assert process.count == 15
    finally:
        process.close()
    assert process._process.returncode == 0  # it has ended by itself


@pytest.mark.slow
def test_a_target_that_is_not_there_is_late_and_one_that_took_long_is_counted(slow):
    process = slow("2:0.013,4:0.2")
    process.reset(0.0)
    for expected in (0, 1, 2):
        process.start(0.0, 0.0, 0.0)
        time.sleep(0.1)
        process.target()
        assert process.slow == expected
    process.start(0.0, 0.0, 0.0)
    with pytest.raises(IntegrationLate, match=r"substeps: an integration was not there after 15 ms, 75 % of"):
        process.target()
    assert process.longest < 0.2
    process.reset(0.0)  # the late answer is no answer to what is asked next
    process.start(0.0, 0.0, 0.0)
    time.sleep(0.1)
    process.target()
    assert (process.count, process.slow) == (1, 0)


@pytest.mark.slow
def test_a_process_that_has_gone_ends_the_test_and_gives_no_other(slow):
    process = slow("99:0.0")
    process.reset(0.0)
    process._process.kill()
    process._process.wait()
    for ask in (lambda: process.start(0.0, 0.0, 0.0), process.target):
        with pytest.raises(IntegrationLate, match="the process that integrates has ended"):
            ask()
    with pytest.raises(InputError, match="the process that integrates has ended"):
        process.reset(0.0)


# ---- the loop


@pytest.mark.slow
def test_simulation_lockstep_and_real_time_are_equal_bit_for_bit(bmd_rths, tmp_path):
    pairs = (
        *(
            "run.time_step=0.02",
            "ground_motion.duration=2.0",
            "run.preflight=skip",
            "run.settling_time=0.0",
            "run.longest_miss_time=2.0",
        ),
        *("numerical_substructure.stiffnesses=[1e6]", "numerical_substructure.substeps=4"),
        *("command_shaper.lead_time=0.02", "force_correction.feedback_scale=0.3", "safety.stuck_time=1.0"),
    )
    set_ = [word for pair in pairs for word in ("--set", pair)]
    records = []
    for command in (("simulate",), ("run", "--composed", "--lockstep"), ("run", "--composed")):
        result = bmd_rths(command[0], CONFIG, *command[1:], *set_, "--json", "--output", str(tmp_path)).wait()
        assert result.status == 0, result.errors
        records.append(read_bag(json.loads(result.output)["bag"]))
    simulated, lockstep, by_the_clock = records
    missed = min(by_the_clock.timing.missed_steps, default=simulated.steps)
    assert missed > 20
    for name in ("desired_acceleration", "required_force", "command", "table_acceleration"):
        expected = getattr(simulated, name)
        assert np.array_equal(expected, getattr(lockstep, name)), name
        assert np.array_equal(expected[: missed + 1], getattr(by_the_clock, name)[: missed + 1]), name
    assert np.abs(simulated.desired_acceleration).max() > 0.1


@pytest.mark.slow
def test_an_integration_that_is_late_brings_the_table_to_rest(start, slow, domain, monkeypatch, tmp_path):
    """Composed nodes over UDP: warned of from 60 % on, and ended at the hand-over, with one line."""
    monkeypatch.setenv(slow_integration.VARIABLE, "10:0.05,20:0.2")
    with ArrivalController(0.5e-3) as controller:
        patient = [pair.split("=") for pair in PATIENT if "preflight" not in pair]
        config = STEPPED.changed(
            run__time_step=0.02,
            numerical_substructure__stiffnesses=[1e6],
            safety__stuck_time=1.0,
            run__scheme="uc",
            run__record=False,
            run__settling_time=0.0,
            table__controller="udp",
            table__address=controller.address,
            ground_motion__duration=4.0,
            **{name.replace(".", "__"): float(value) for name, value in patient},
        )
        file = tmp_path / "slow.yaml"
        file.write_text(dump_config(config), encoding="utf-8")
        code = "import sys; from tests.nodes.slow_integration import composed_nodes; sys.exit(composed_nodes())"
        parameters = ("--ros-args", "--params-file", str(file), "-p", "exit_when_done:=true")
        result = start("-c", code, *parameters).wait()
        assert result.status == 1, result.errors
        told = result.output + result.errors
        assert "failed: numerical_substructure.substeps: an integration was not there after 60 ms, 75 % of its" in told
        counts = re.search(r"(\d+) of (\d+) integrations took 60 % of their steps or more, the longest", told)
        assert counts, told
        assert 1 <= int(counts[1]) <= int(counts[2]) - 9
        assert int(counts[2]) <= 19
        assert "Traceback" not in told
        at_rest(controller)
        never_in_bursts(controller, 4 * 20)
