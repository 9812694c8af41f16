"""What every compensator must do: those of the package, those that are installed, and the example of the docs."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter_ns

import numpy as np
import pytest

from bmd_rths_core.compensators.protocol import Compensator
from bmd_rths_core.compensators.registry import compensators
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.build import make_known
from bmd_rths_core.table.controller import TableMeasurement
from tests.core.mpic_parts import exact

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "reference" / "compensators.md"
GUIDE = DOCS / "how-to" / "add_a_compensator.md"
EXAMPLE = re.search(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)[1]
DOCUMENTED = "derivative"
#: Most that a step may cost, in steps of the phase lead of the paper, which is a handful of multiplications.
MOST_COST = 250.0
STEPS = 80
#: Those that need no model of the table.
_PAPER = ("uc", "fc", "plc", "plc_fc")


def documented():
    namespace = {"__name__": "example"}
    exec(EXAMPLE, namespace)
    return namespace["DERIVATIVE_LEAD"]


def known_of(entry, **changes):
    """Return what is known, with the settings of the entry."""
    config = exact(**changes)
    if entry.name in compensators():
        return make_known(config.changed(run__scheme=entry.name))
    return replace(make_known(config.changed(run__scheme="uc")), settings=entry.settings())


def made(entry):
    return (entry.shaper or entry.control)(known_of(entry))


@pytest.fixture(params=[*compensators(), DOCUMENTED])
def entry(request):
    return documented() if request.param == DOCUMENTED else compensators()[request.param]


def signals(seed=0, lost=()):
    """Return what a compensator is told in each step: ground or desired acceleration, and the sensors after it."""
    random = np.random.default_rng(seed)
    inputs, sensors = random.standard_normal((STEPS, 40)), random.standard_normal((STEPS, 5))
    measured = []
    for k in range(STEPS):
        table, first, second, displacement, shear = sensors[k].tolist()
        if k in lost:
            table = first = np.nan
        floors = np.array([first, second])
        measured.append(TableMeasurement(k, np.nan, 1e-3 * displacement, table, 0.0, 1e3 * shear, floors))
    return inputs, measured


def advance(entry, part, inputs, measured, missing=()):
    """Return the outputs of every step; the command that was asked for is applied."""
    outputs = []
    for k in range(STEPS):
        if entry.control is not None:
            demand = part.step(inputs[k, : part.preview + 1])
            outputs.append([*demand, *part.displacements])
        else:
            outputs.append([part.step(float(inputs[k, 0]))])
        if k not in missing:
            part.learn(measured[k]._replace(applied_command=outputs[-1][2 if entry.control is not None else 0]))
    return np.array(outputs)


def test_example_of_the_documentation_is_short():
    assert len([line for line in EXAMPLE.splitlines() if line.strip()]) <= 30
    assert isinstance(documented(), Compensator)


def test_reset_repeats_the_run_and_is_as_new(entry):
    part = made(entry)
    part.reset()
    first = advance(entry, part, *signals())
    part.reset()
    advance(entry, part, *signals(seed=1), missing=(3, 4, 50))
    part.reset()
    assert (advance(entry, part, *signals()) == first).all()
    assert (advance(entry, made(entry), *signals()) == first).all()


def test_two_of_them_share_nothing(entry):
    one, other = made(entry), made(entry)
    alone = advance(entry, one, *signals())
    advance(entry, other, *signals(seed=1))
    one.reset()
    for _ in range(2):
        advance(entry, other, *signals(seed=2))
    assert (advance(entry, one, *signals()) == alone).all()


def test_outputs_are_finite_whatever_is_lost(entry):
    outputs = advance(entry, made(entry), *signals(lost=(5, 6, 40)), missing=(10, 11, 12, 60))
    assert np.isfinite(outputs).all()


def test_rest_is_rest(entry):
    inputs, measured = signals()
    still = [entry_._replace(table_displacement=0.0, table_acceleration=0.0, base_shear=0.0) for entry_ in measured]
    still = [entry_._replace(floor_accelerations=np.zeros(2)) for entry_ in still]
    assert not advance(entry, made(entry), 0.0 * inputs, still).any()


def test_linear_system_is_the_steps(entry):
    part = made(entry)
    inputs, measured = signals()
    own = advance(entry, part, inputs, measured)
    linear = part.state_space()
    if linear is None:
        held = part.held()
        assert np.abs(np.linalg.eigvals(held.a)).max(initial=0.0) < 1.0
        assert held.b.shape[1] in (1, 1 + 6)
        return
    system = linear if entry.control is None else linear.system
    width = system.b.shape[1]
    front = 1 if entry.control is None else part.preview + 1
    assert width in (front, front + 6)
    state = np.zeros(len(system.a)) if entry.control is None else linear.start * inputs[0, 0]
    sensors, found = np.zeros(6), []
    for k in range(STEPS):
        u = np.concatenate((inputs[k, :front], sensors))[:width]
        found.append(system.c @ state + system.d @ u)
        state = system.a @ state + system.b @ u
        m = measured[k]
        floors = m.floor_accelerations
        sensors = np.array([m.table_acceleration, *floors, m.base_shear, m.table_displacement, m.actuator_force])
    np.testing.assert_allclose(found, own, rtol=1e-7, atol=1e-9 * np.abs(own).max())


def fastest(entry):
    """Return the time of a step in ns, the least of several runs."""
    part, (inputs, measured) = made(entry), signals()
    times = []
    for _ in range(12):
        part.reset()
        begin = perf_counter_ns()
        advance(entry, part, inputs, measured)
        times.append((perf_counter_ns() - begin) / STEPS)
    return min(times)


def test_step_costs_little(entry):
    plain = fastest(compensators()["plc"])
    assert fastest(entry) < MOST_COST * plain


def test_without_a_table_it_works_or_refuses_in_one_line_that_names_itself(entry):
    known = known_of(entry, identified_model__table="none")
    if entry.name in (*_PAPER, DOCUMENTED):
        part = (entry.shaper or entry.control)(known)
        assert np.isfinite(advance(entry, part, *signals())).all()
        return
    with pytest.raises(InputError) as refusal:
        (entry.shaper or entry.control)(known)
    assert re.fullmatch(rf"identified_model\.table: none; scheme {entry.name} requires .+", str(refusal.value))


def test_it_says_what_it_does_and_needs(entry):
    assert re.fullmatch(r"[a-z][a-z0-9_]*", entry.name)
    assert entry.summary
    assert entry.needs
    assert (entry.shaper is None) != (entry.control is None)
    row = rf"`{entry.name}`"
    assert row in PAGE.read_text(encoding="utf-8") or entry.name == DOCUMENTED


# One new file of a third party, and nothing else

USE = """
import json
import numpy as np
from bmd_rths_core.analysis.preflight import predict_test
from bmd_rths_core.campaign.engine import SelectedMotion, run_motions
from bmd_rths_core.config import Config, config_from_mapping, dump_config
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_core.stability.analysed_loops import AnalysisOptions
from bmd_rths_core.stability.assessment import assess

config = Config().changed(run__scheme="derivative", derivative_lead__lead_time=0.02)
assert "derivative_lead" in dump_config(config)
assert config_from_mapping(config.as_mapping()) == config
ground = 0.3 * np.sin(np.arange(400) * 0.06) * np.minimum(1.0, np.arange(400) / 100.0)
motion = GroundMotion("sine", 0.005, ground, "made here", "0" * 64)
record = RthsLoop(config, motion).run()
plain = RthsLoop(config.changed(run__scheme="uc"), motion).run()
run = run_motions(config, [SelectedMotion(config.ground_motion, motion)])[0]
flight = predict_test(config, motion)
print(json.dumps({
    "outcome": record.outcome,
    "differs": bool(np.abs(record.command - plain.command).max() > 0.01),
    "engine": run.engine,
    "same": bool(np.allclose(run.record.command, record.command, atol=1e-9)),
    "radius": assess(config, AnalysisOptions()).discrete.spectral_radius,
    "problems": flight.problems,
    "peak": flight.peaks.acceleration,
    "peak_of_record": float(np.abs(record.command).max()),
}))
"""


def install(folder):
    """Write a package as an installer leaves it, the module of the documentation in it."""
    (folder / "third_party_lead.py").write_text(EXAMPLE, encoding="utf-8")
    metadata = folder / "third_party_lead-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: third-party-lead\nVersion: 1.0\n")
    points = "[bmd_rths.compensators]\nderivative = third_party_lead:DERIVATIVE_LEAD\n"
    (metadata / "entry_points.txt").write_text(points)


def python(folder, text):
    path = os.pathsep.join([str(folder), *(entry for entry in sys.path if entry)])
    return subprocess.run(
        [sys.executable, "-c", text], env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_a_third_party_adds_one_file(tmp_path):
    install(tmp_path)
    done = python(tmp_path, USE)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["outcome"] == "finished"
    assert found["differs"]
    assert found["engine"] == "linear"
    assert found["same"]
    assert 0.9 < found["radius"] < 1.0
    assert found["problems"] == []
    assert found["peak"] == found["peak_of_record"]


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ("x = third_party_lead:make\n", "entry point x of bmd_rths.compensators: third_party_lead:make is no Compen"),
        (
            "x = third_party_lead:DERIVATIVE_LEAD\ny = third_party_lead:DERIVATIVE_LEAD\n",
            "entry point y of bmd_rths.compensators: there is a compensator 'derivative' already",
        ),
    ],
)
def test_an_entry_point_that_is_wrong_is_named(tmp_path, points, message):
    install(tmp_path)
    (tmp_path / "third_party_lead-1.0.dist-info" / "entry_points.txt").write_text("[bmd_rths.compensators]\n" + points)
    done = python(tmp_path, "from bmd_rths_core.config import Config")
    assert done.returncode != 0
    assert message in done.stderr
