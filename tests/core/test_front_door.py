"""`import bmd_rths_core` offers what a study begins with, and imports none of it before it is used."""

import subprocess
import sys
from pathlib import Path

import pytest

import bmd_rths_core

CONFIG = Path(__file__).parents[2] / "config" / "simplified_bmd.yaml"


@pytest.mark.parametrize("name", bmd_rths_core.__all__)
def test_every_name_is_the_public_one_of_its_module(name):
    item = getattr(bmd_rths_core, name)
    assert getattr(sys.modules[getattr(item, "__module__", "bmd_rths_core.version")], name) is item
    assert name in dir(bmd_rths_core)


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="has no attribute 'RthsLop'"):
        _ = bmd_rths_core.RthsLop


def test_a_test_in_process_needs_nothing_else():
    config = bmd_rths_core.load_config(CONFIG).changed(ground_motion__duration=1.0)
    motion = bmd_rths_core.select_ground_motion(config.ground_motion, config.run.time_step)
    record = bmd_rths_core.RthsLoop(config, motion).run()
    assert isinstance(record, bmd_rths_core.RunRecord)
    assert record.outcome == "finished"
    assert bmd_rths_core.run_metrics(record).missing_values == 0


def imported_after(statements):
    """Return the modules that a fresh interpreter has after some statements."""
    code = f"import sys\n{statements}\nprint(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_the_door_itself_imports_nothing():
    ours = {name for name in imported_after("import bmd_rths_core") if name.startswith("bmd_rths")}
    assert ours == {"bmd_rths_core", "bmd_rths_core.version"}
    assert "numpy" in imported_after("import bmd_rths_core; bmd_rths_core.RthsLoop")


#: scipy takes all that numpy has; who wants the parts that nobody here uses still gets them.
UNUSED_PARTS = """
from bmd_rths_core.integration.discretisation import zero_order_hold
import numpy as np
zero_order_hold(np.zeros((1, 1)), np.ones((1, 1)), 0.005)
assert "scipy.linalg" in sys.modules
left = {"numpy.f2py.f2py2e", "numpy.ma.core", "numpy.polynomial.chebyshev", "numpy.testing._private.utils", "unittest"}
assert left.isdisjoint(sys.modules)
np.testing.assert_allclose(1.0, 1.0)
from numpy.testing import assert_array_equal
import numpy.f2py
assert callable(numpy.f2py.get_include)
from numpy.ma import masked_invalid
assert masked_invalid([1.0, np.nan]).count() == 1
assert np.polynomial.Polynomial([1.0, 2.0])(2.0) == 5.0
"""


def test_scipy_does_not_load_what_nobody_uses():
    used = {"numpy.f2py.f2py2e", "numpy.ma.core", "numpy.polynomial.chebyshev", "numpy.testing._private.utils"}
    assert used <= imported_after(UNUSED_PARTS)
