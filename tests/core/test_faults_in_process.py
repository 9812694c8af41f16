"""Faults in virtual time: after each of them the table is at rest, within its limits, and the reason is told."""

import math

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.emulated.faults import Faults, parse_fault
from bmd_rths_core.table.emulated.true_motion import TrueMotion
from bmd_rths_core.table.udp_controller import make_udp_table
from bmd_rths_core.table.wire import ControllerState
from tests.faults.in_process import KINDS, outcome_of
from tests.faults.outcome import Outcome, summary, wrong_motion
from tests.faults.rig import SESSION, Rig, Trial, VirtualNetwork

#: What the reason of seed 0 names: the fault, and not what follows from it.
NAMED = {
    "dead_controller": "safety.stale_controller_time",
    "frozen_controller": "answers step",
    "nan_sensor": "safety.non_finite_action",
    "stuck_sensor": "safety.stuck_time",
    "drifting_command": "safety.displacement_limit",
    "dead_host": "watchdog",
    "unstable": "safety.",
}


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_table_is_safe_and_the_reason_is_the_fault(kind, seed):
    outcome = outcome_of(kind, seed)
    assert outcome.wrong == ()
    if seed == 0:
        assert NAMED.get(kind, "") in outcome.reason


def test_every_fault_whose_reason_is_known_is_tried():
    assert set(NAMED) <= set(KINDS)


@pytest.mark.slow
def test_outcome_depends_on_the_seed_alone():
    first, again, other = outcome_of("loss", 5), outcome_of("loss", 5), outcome_of("loss", 6)
    assert repr(first) == repr(again)
    assert first.peaks != other.peaks


@pytest.mark.parametrize(
    ("motion", "peaks", "wrong"),
    [
        ((0.1, 0.0, 0.0, 0.0), (0.2549, 1.0, 3.0, 4e5), None),
        ((0.0, 0.0, 0.0, 0.0), (0.2551, 1.0, 3.0, 4e5), "displacement"),
        ((0.0, 0.0, 0.0, 0.0), (0.1, 1.02, 3.0, 4e5), "velocity"),
        ((0.0, 0.0, 0.0, 0.0), (0.1, 0.5, 46.0, 4e5), "acceleration"),
        ((0.0, 0.0, 0.0, 0.0), (0.1, 0.5, 3.0, 6e5), "force"),
        ((0.0, 0.0, 0.0, 0.0), (math.nan, 0.5, 3.0, 4e5), "displacement"),
        ((0.0, -0.01, 0.0, 0.0), (0.1, 0.5, 3.0, 4e5), "not at rest"),
    ],
)
def test_judge_finds_what_a_table_should_not_do(motion, peaks, wrong):
    """More than one step's motion beyond 0.25 m, 1 m/s, 30 m/s² or 500 kN, or a table that moves at the end."""
    found = wrong_motion(Config(), TrueMotion(*motion), TrueMotion(*peaks))
    assert [wrong in text for text in found] == ([True] if wrong else [])


def connected(config, *faults):
    network = VirtualNetwork(config, Faults(parse_fault(text) for text in faults))
    table = make_udp_table(config, network, SESSION)
    table.connect()
    return network, table


def test_network_without_faults_is_the_table():
    """The packets change nothing: answers come 3 ms after their command, with what was asked for."""
    config = Config().changed(virtual_controller__model="servo", simulated_table__acceleration_noise=0.0)
    network, table = connected(config)
    begin = network.time
    assert network.controller.state is ControllerState.ARMED
    for step in range(100):
        network.sleep(1e-9 * begin + step * config.run.time_step)
        measurement = table.exchange(TableCommand(step, 1.0))
        assert measurement.step == step
        assert measurement.applied_command == 1.0
    assert network.time - begin == 99 * 5_000_000 + 3_000_000
    assert measurement.table_displacement == pytest.approx(0.5 * 0.498**2, rel=0.1)  # less the delay of 20 ms


def test_late_answers_count_on_the_way_to_rest():
    """A loop has no use for an answer that comes after 11 ms; who brings a table to rest has."""
    config = Config().changed(virtual_controller__model="servo")
    for patient in (False, True):
        network, table = connected(config, "delay=4@0")
        begin, seen = network.time, []
        if patient:
            table.be_patient()
        for step in range(40):
            network.sleep(1e-9 * begin + step * config.run.time_step)
            while (measurement := table.poll()) is not None:
                seen.append(measurement.step)
            table.begin(TableCommand(step, 0.5))
        assert seen == (list(range(37)) if patient else [])


@pytest.mark.parametrize("late", [0, 4])
def test_where_the_table_is_on_the_way_to_rest_is_recorded_however_late_it_is_told(late):
    patient = {f"safety__stale_{of}_time": 9.0 for of in ("shear", "controller")} | {"run__longest_miss_time": 9.0}
    config = Config().changed(safety__acceleration_limit=0.5, ground_motion__duration=4.0, **patient)
    rig = Rig(Trial("late answers", config, 0, (f"delay={late}@0",)))
    rig.run()
    assert np.isfinite(rig.record.way_to_rest.table_displacement).mean() > 0.95


@pytest.mark.parametrize("sensor", ["acceleration", "displacement", "force", "shear", "floor_2"])
def test_sensor_that_gives_nan_is_the_one_that_was_named(sensor):
    network, table = connected(Config(), f"nan={sensor}@2")
    values = []
    for step in range(4):
        network.sleep(1.0 + 0.005 * (step + 1))
        m = table.exchange(TableCommand(step, 0.1))
        values.append(
            {
                "acceleration": m.table_acceleration,
                "displacement": m.table_displacement,
                "force": m.actuator_force,
                "shear": m.base_shear,
                "floor_1": m.floor_accelerations[0],
                "floor_2": m.floor_accelerations[1],
            }
        )
    for found, expected in zip(values, ([], [], [sensor], [sensor]), strict=True):
        assert [name for name, value in found.items() if math.isnan(value)] == expected


def test_summary_counts_by_kind_and_end():
    def outcome(kind, ended, *wrong):
        return Outcome(kind, "", ended, "", wrong, TrueMotion())

    table = summary([outcome("loss", "limit"), outcome("loss", "limit", "x"), outcome("dead", "failed")])
    assert {kind: dict(ends) for kind, ends in table.items()} == {
        "loss": {"limit": 2, "wrong": 1},
        "dead": {"failed": 1, "wrong": 0},
    }
    assert np.isnan(outcome("loss", "limit").rest_time)
