"""`bmd-rths doctor`: every look finds what is wrong with a computer that was made up, and says what to change."""

import json
import re
import sys
import types
from pathlib import Path

import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.closure_times import ClosureTimes
from bmd_rths_core.record import TimingStatistics
from bmd_rths_nodes.doctor import measured
from bmd_rths_nodes.doctor.finding import GOOD, LEVELS, NOTE, PROBLEM, WARNING, Finding, change_first, worst
from bmd_rths_nodes.doctor.machine import Machine
from bmd_rths_nodes.doctor.measured import Jitter, LoopRun
from tests.nodes.conftest import CONFIG, ROOT
from tests.pages import blocks_of

PAGE = ROOT / "docs" / "how-to" / "check_the_computer.md"

#: Files of a computer on which nothing is wrong.
FILES = {
    "proc/sys/net/ipv4/ip_local_port_range": "32768\t60999",
    "proc/sys/net/core/rmem_default": "212992",
    "proc/loadavg": "0.05 0.10 0.20 1/200 1234",
    "proc/cpuinfo": "processor\t: 0\nflags\t\t: fpu tsc\n",
    "proc/sys/kernel/osrelease": "6.1.0",
    "sys/kernel/realtime": "1",
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "tsc",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance",
    "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "performance",
}
ENVIRONMENT = {"ROS_DOMAIN_ID": "30", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def looked_at(tmp_path, files=None, environment=None):
    """Return the findings by name on a computer where some things are another way; None takes a file away."""
    for name, content in {**FILES, **(files or {})}.items():
        if content is not None:
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(f"{content}\n")
    return {f.name: f for f in Machine(tmp_path, {**ENVIRONMENT, **(environment or {})}).findings()}


def test_nothing_is_wrong_with_a_good_computer(tmp_path):
    found = looked_at(tmp_path)
    assert {name: finding.level for name, finding in found.items() if finding.level != GOOD} == {}
    assert all(finding.advice == "" for finding in found.values())


@pytest.mark.parametrize(
    ("files", "environment", "name", "level", "words"),
    [
        ({}, {"ROS_DOMAIN_ID": "233"}, "ROS domain", PROBLEM, "0 to 232"),
        ({}, {"ROS_DOMAIN_ID": "x"}, "ROS domain", PROBLEM, "0 to 232"),
        ({}, {"ROS_DOMAIN_ID": ""}, "ROS domain", NOTE, "one of its own"),
        ({}, {"ROS_DOMAIN_ID": "102"}, "ROS domain", WARNING, "below 101"),
        ({}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, "discovery range", PROBLEM, "LOCALHOST"),
        ({}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": ""}, "discovery range", NOTE, "LOCALHOST"),
        ({}, {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "middleware", WARNING, "unset RMW_IMPLEMENTATION"),
        ({}, {"FASTRTPS_DEFAULT_PROFILES_FILE": "/mine.xml"}, "middleware", WARNING, "shared memory"),
        ({}, {"ROS_DISTRO": "humble"}, "ROS 2", WARNING, "jazzy"),
        ({"dev/shm/fastrtps_7412": ""}, {}, "shared memory", NOTE, "rm /dev/shm/fastrtps_*"),
        ({"proc/sys/net/core/rmem_default": "65536"}, {}, "receive buffer", WARNING, "rmem_default=212992"),
        ({"proc/loadavg": "9.00 1 1 1/2 3"}, {}, "processors", WARNING, "end other work"),
        (
            {"sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "powersave"},
            {},
            "processor speed",
            WARNING,
            "-g performance",
        ),
        ({"proc/cpuinfo": "flags\t\t: fpu hypervisor tsc\n"}, {}, "computer", WARNING, "of its own"),
        ({"proc/cpuinfo": None}, {}, "computer", NOTE, ""),
        ({"sys/kernel/realtime": None}, {}, "kernel", NOTE, "PREEMPT_RT"),
        (
            {"sys/devices/system/clocksource/clocksource0/current_clocksource": "hpet"},
            {},
            "clock",
            WARNING,
            "tsc",
        ),
    ],
    ids=str,
)
def test_what_is_wrong_is_found_with_what_to_change(tmp_path, files, environment, name, level, words):
    found = looked_at(tmp_path, files, environment)
    assert (found[name].level, words in found[name].advice) == (level, True), found[name]
    assert {finding.name for finding in found.values() if finding.level != GOOD} == {name}


def test_a_system_that_tells_nothing_is_no_problem(tmp_path):
    found = Machine(tmp_path, ENVIRONMENT).findings()
    assert worst(found) == NOTE


def test_worst_is_the_worst():
    assert worst([]) == GOOD
    for i, level in enumerate(LEVELS):
        assert worst([Finding("", lower, "") for lower in LEVELS[: i + 1]]) == level


def test_what_to_change_first_is_the_cause_of_what_was_measured():
    busy, late = Finding("processors", WARNING, "", "end other work"), Finding("timer", WARNING, "", "own processors")
    full, slow = Finding("disk", PROBLEM, "", "free some room"), Finding("loop", PROBLEM, "", "a longer run.time_step")
    told = Finding("kernel", NOTE, "", "PREEMPT_RT")
    assert change_first([told, busy, late, slow]) == "processors: end other work"
    assert change_first([busy, full, slow]) == "disk: free some room"
    assert change_first([told, slow]) == "a longer run.time_step"
    assert change_first([told]) == ""


# ---- measured


def test_percentiles_are_values_that_were_measured():
    values = [float(i) for i in range(1, 101)]
    assert [measured.percentile(values, p) for p in (1, 50, 99, 100)] == [1.0, 50.0, 99.0, 100.0]
    assert measured.percentile([7.0], 50) == 7.0


def test_timer_wakes_up_late_but_never_early():
    jitter = measured.timer(0.002, 0.1)
    assert 0.0 <= jitter.p50 <= jitter.p99 <= jitter.largest


@pytest.mark.parametrize(("late", "level"), [(0.1, GOOD), (0.9, GOOD), (1.1, WARNING)])
def test_timer_is_judged_by_the_step(late, level):
    assert measured.jitter_finding(Jitter(0.05, late, 9.0), 0.005).level == level


def test_disk_is_measured_where_the_bags_will_be(tmp_path):
    finding = measured.disk(tmp_path / "not" / "there" / "yet")
    assert "MB/s" in finding.found
    assert list(tmp_path.iterdir()) == []
    gone = measured.disk(Path("/proc"))
    assert (gone.level, gone.advice) == (PROBLEM, "choose another --output")


def test_port_in_use_is_told(monkeypatch):
    with measured.socket.socket(measured.socket.AF_INET, measured.socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        monkeypatch.setattr(measured, "_TABLE_PORT", other.getsockname()[1])
        assert measured.table_port().level == NOTE
    assert measured.table_port().level == GOOD


def test_nodes_of_a_test_are_more_than_other_nodes():
    assert measured.others_finding([]).level == GOOD
    assert measured.others_finding(["/camera"]).level == NOTE
    assert measured.others_finding(["/camera", "/rths/recorder"]).level == WARNING


def run(missed=0, closure=0.4, outcome="finished", steps=2000):
    """Return a test whose steps closed after the same time [ms], but for those that were late."""
    times = ClosureTimes(0.005)
    for _ in range(steps - missed):
        times.add(1e-3 * closure)
    told = {"p50": closure, "p99": closure, "max": closure}
    return LoopRun(200.0, steps, TimingStatistics(missed, 0, (), 0, told, times.counts), outcome)


@pytest.mark.parametrize(
    ("found", "level"),
    [(run(), GOOD), (run(3), WARNING), (run(20), WARNING), (run(21), PROBLEM), (run(outcome="failed: x"), PROBLEM)],
)
def test_loop_is_judged_by_its_misses(found, level):
    assert measured.loop_finding(found).level == level


JITTER = Jitter(0.05, 0.2, 1.0)


def test_verdict_is_a_sentence_with_rate_and_misses():
    assert measured.verdict(run(3), JITTER) == (
        "This computer holds 200 Hz with composed nodes: 3 of 2000 deadlines missed. "
        "By the same closure times, 1000 Hz would have 3 late."
    )
    assert "500 Hz would have 0 late" in measured.verdict(run(closure=1.5), JITTER)
    assert "500 Hz would have 5 late" in measured.verdict(run(5, closure=1.5), JITTER)
    assert measured.verdict(run(500), JITTER) == (
        "This computer does not hold 200 Hz with composed nodes: 500 of 2000 deadlines missed. "
        "Look again with a longer run.time_step."
    )
    assert measured.verdict(run(closure=4.9), JITTER).endswith("0 of 2000 deadlines missed.")


def test_sentence_of_the_page_is_one_of_ours():
    (quoted,) = (block.text for block in blocks_of(PAGE) if block.language == "")
    assert re.sub(r"\d+", "#", " ".join(quoted.split())) == re.sub(r"\d+", "#", measured.verdict(run(), JITTER))


# ---- the command


def test_a_look_without_measuring(run_main):
    status, output, _ = run_main("doctor", CONFIG, "--quick", "--json")
    told = json.loads(output)
    names = {check["name"] for check in told["checks"]}
    assert {"Python", "ROS 2", "ROS domain", "clock", "processors", "UDP port 50600"} <= names
    assert (told["verdict"], status) == (None, int(told["level"] == PROBLEM))
    assert (told["change_first"] is None) == (told["level"] in (GOOD, NOTE))
    status, output, _ = run_main("doctor", CONFIG, "--quick")
    assert "Python" in output


@pytest.mark.slow
def test_a_whole_examination_runs_a_real_test(run_main):
    status, output, errors = run_main("doctor", CONFIG, "--duration", "2", "--json")
    told = json.loads(output)
    (loop,) = (check for check in told["checks"] if check["name"] == "loop")
    assert "deadlines missed at 200 Hz" in loop["found"], errors
    assert "200 Hz with composed nodes" in told["verdict"]
    assert status == int(told["level"] == PROBLEM)
    assert [check["found"] for check in told["checks"] if check["name"] == "other nodes"] == ["none on this domain"]


def test_a_test_that_does_not_run_is_one_line(monkeypatch):
    monkeypatch.setattr(measured.sys, "executable", "/bin/false")
    from bmd_rths_core import load_config

    with pytest.raises(InputError, match="the test did not run"):
        measured.run_loop(load_config(CONFIG), 1.0)


def test_ros2_doctor_tells_the_same(monkeypatch):
    """`ros2cli` is no wheel: what `ros2doctor` of Jazzy has takes its place. A result counts, the check prints."""

    class Result:
        def __init__(self):
            self.error = self.warning = 0

        def add_error(self):
            self.error += 1

        def add_warning(self):
            self.warning += 1

    errors, warnings = [], []
    package, api, output = (types.ModuleType(f"ros2doctor{rest}") for rest in ("", ".api", ".api.format"))
    api.DoctorCheck, api.Result = object, Result
    output.doctor_error, output.doctor_warn = errors.append, warnings.append
    for module in (package, api, output):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.delitem(sys.modules, "bmd_rths_nodes.doctor.ros2", raising=False)
    monkeypatch.setenv("ROS_DOMAIN_ID", "500")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")
    from bmd_rths_nodes.doctor.ros2 import BmdRthsCheck

    check = BmdRthsCheck()
    result = check.check()
    assert check.category() == "bmd_rths"
    assert [text for text in errors if text.startswith("bmd_rths: ROS domain: 500; set ROS_DOMAIN_ID")]
    assert [text for text in warnings if text.startswith("bmd_rths: middleware: rmw_zenoh_cpp; unset")]
    assert (result.error, result.warning) == (len(errors), len(warnings))
    sys.modules.pop("bmd_rths_nodes.doctor.ros2")
