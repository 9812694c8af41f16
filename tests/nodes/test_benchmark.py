"""``bmd-rths benchmark vrths``: table, JSON, bags and report."""

import json

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

import bmd_rths_nodes.cli.benchmark as benchmark
from bmd_rths_core.ground_motion.formats.record_format import UNIT_CHOICES
from bmd_rths_core.ground_motion.formats.stated import FROM_FILE

FEW = ("--cases", "2", "--schemes", "velocity_lead,lqg_adaptive", "--plants", "2", "--jobs", "1", "--output", "out")


def pulse(tmp_path, amplitude):
    """Write a record of one second."""
    path = tmp_path / "pulse.csv"
    times = np.arange(101) * 0.01
    values = amplitude * np.sin(2.0 * np.pi * 4.0 * times) * np.sin(np.pi * times)
    path.write_text(
        "time_s,acceleration_m/s2\n" + "".join(f"{t:.2f},{a:.6f}\n" for t, a in zip(times, values, strict=True))
    )
    return path


@pytest.fixture
def record(tmp_path):
    return pulse(tmp_path, 1.0)


@pytest.mark.slow
def test_json_bags_and_report(run_main, record):
    status, output, errors = run_main("benchmark", "vrths", "--motion", record, *FEW, "--json")
    assert (status, errors) == (0, "")
    told = json.loads(output)
    runs = told["runs"]
    assert [(run["scheme"], run["plant"]) for run in runs] == [
        (scheme, plant)
        for scheme in ("velocity_lead", "lqg_adaptive")
        for plant in ("nominal", "perturbed_1", "perturbed_2")
    ]
    assert {(run["case"], run["motion"]) for run in runs} == {(2, "pulse")}
    assert all(set(run) >= {f"J{i}" for i in range(1, 10)} for run in runs)
    assert told["units"]["J1"] == "ms"
    with open("out/vrths.json") as file:
        assert json.load(file) == told
    with open("out/report.html", encoding="utf-8") as file:
        page = file.read()
    assert f"<td>{runs[0]['J4']:.2f}</td>" in page
    assert "<img" in page

    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader("out/bags/pulse_lqg_adaptive_case_2") as bag:
        points = [
            (store.deserialize_cdr(data, connection.msgtype), stamp)
            for connection, stamp, data in bag.messages()
            if connection.topic == "/rths/actuator_displacement"
        ]
    assert len(points) == 513  # every eighth step of 4097
    assert [stamp for _, stamp in points] == [1_953_125 * i for i in range(513)]
    last = points[-1][0]
    assert (last.header.stamp.sec, last.header.stamp.nanosec) == (1, 0)
    assert max(abs(point.point.y) for point, _ in points) > 1e-4


def test_motion_that_no_actuator_of_the_problem_can_follow_is_told(run_main, tmp_path):
    only = ("--cases", "2", "--schemes", "velocity_lead", "--plants", "0", "--jobs", "1", "--output", "out", "--json")
    status, output, errors = run_main("benchmark", "vrths", "--motion", pulse(tmp_path, 20.0), *only)
    (run,) = json.loads(output)["runs"]
    assert status == 0
    assert run["force_limited"] is True
    assert run["required_force"] > 8900.0
    words = f"pulse, building 2: its motion without partition needs {run['required_force']:.0f} N, more than the 8900 N"
    assert words in errors
    with open("out/report.html", encoding="utf-8") as file:
        page = file.read()
    assert words in page
    assert "The actuator was at its force limit in 1 of 1 tests." in page


def test_table_is_shown(run_main, record):
    status, output, _ = run_main("benchmark", "vrths", "--motion", record, *FEW[:2], "--schemes", "uc", *FEW[4:])
    assert status == 0
    assert "uc, pulse at 0.4 of the record" in output
    for text in ("nominal", "mean of 2", "worst of 2", "J1 [ms]", "J9 [%]"):
        assert text in output


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("--cases", "1,5"), "error: --cases 1,5: '5' is not a building; some of 1,2,3,4 are required\n"),
        (("--schemes", "fc"), "error: scheme fc: corrects the force of a shake table, and tracks no displacement"),
        (("--motion", "kobe"), "error: --motion kobe: BMD_RTHS_GROUND_MOTIONS is not set; a folder with Kobe/RSN1106"),
    ],
)
def test_wrong_input_is_refused(run_main, monkeypatch, arguments, problem):
    monkeypatch.delenv("BMD_RTHS_GROUND_MOTIONS", raising=False)
    status, output, errors = run_main("benchmark", "vrths", *arguments)
    assert (status, output) == (2, "")
    assert errors.startswith(problem)


def test_same_name_twice_is_refused(run_main, record, tmp_path):
    other = tmp_path / "other" / "pulse.csv"
    other.parent.mkdir()
    other.write_bytes(record.read_bytes())
    status, _, errors = run_main("benchmark", "vrths", "--motion", record, "--motion", other)
    assert (status, errors) == (
        2,
        "error: --motion: two records are called 'pulse'; one of each name is required\n",
    )


def test_units_are_those_of_the_records():
    """The help of the command does without numpy, which the readers need."""
    assert benchmark.UNITS == UNIT_CHOICES
    assert benchmark.FROM_FILE == FROM_FILE
