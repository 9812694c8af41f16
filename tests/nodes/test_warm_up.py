"""Nothing that is slow only the first time runs between two commands."""

from pathlib import Path

#: Calls that a log call may make: with so many it takes less than a millisecond, and a step has 5.
ALLOWED = 2000


def test_the_first_log_call_does_not_stall_the_loop(start):
    script = Path(__file__).with_name("first_log_call.py")
    first = {}
    for kind in ("cold", "warm"):
        result = start(script, kind).wait()
        assert result.status == 0, result.errors
        assert result.errors.count("table is stopped") == 3, result.errors  # the warm-up itself says nothing
        assert len(result.errors.splitlines()) == 3, result.errors
        first[kind], *further = [int(line) for line in result.output.split()]
        assert max(further) < ALLOWED, kind
    assert first["warm"] < ALLOWED
    assert first["cold"] > 10 * ALLOWED  # otherwise rclpy has mended it, and the warm-up can go


def test_what_waits_for_its_first_use_is_not_loaded(start):
    script = """
import sys
from bmd_rths_core.scipy_loading import leave_for_later
from bmd_rths_nodes.ros.warm_up import warm_up

leave_for_later()
before = type(sys.modules["numpy.f2py"])
warm_up()
print(before.__name__, type(sys.modules["numpy.f2py"]).__name__)
"""
    result = start("-c", script).wait()
    assert result.output.split() == ["_LazyModule", "_LazyModule"], result.errors
