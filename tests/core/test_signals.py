"""One table of signals: the record, the measurement and the nomenclature say the same."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from bmd_rths_core.record import RunRecord, empty_signals
from bmd_rths_core.signals import MEASUREMENT, SIGNALS, Instant
from bmd_rths_core.table.controller import TableMeasurement

NOMENCLATURE = (Path(__file__).parents[2] / "docs" / "reference" / "nomenclature.md").read_text(encoding="utf-8")


def test_the_record_has_these_signals_in_this_order():
    assert [field.name for field in fields(RunRecord) if field.type == "FloatArray"] == [s.name for s in SIGNALS]
    assert list(empty_signals(3, 2)) == [s.name for s in SIGNALS]


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda signal: signal.name)
def test_shape_and_unit_in_the_record(signal):
    assert empty_signals(3, 2)[signal.name].shape == ((3, 2) if signal.per_floor else (3,))
    assert np.isnan(empty_signals(3, 2)[signal.name]).all()
    shape = r"\(N, n\)" if signal.per_floor else r"\(N,\)"
    described = re.search(rf"{signal.name} : ndarray, shape {shape}\n +(?P<text>.*)\n", RunRecord.__doc__)
    assert described["text"].endswith(f"[{signal.unit}].")


def test_the_measurement_is_what_the_table_controller_tells():
    assert {s.name for s in SIGNALS if s.measured} == set(TableMeasurement._fields) - {"step"}
    sensors = {s.name for s in SIGNALS if s.topic == MEASUREMENT and s.instant is Instant.END}
    assert sensors == set(TableMeasurement._fields) - {"step", "applied_command"}


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda signal: signal.name)
def test_the_nomenclature_has_its_symbol_unit_and_place(signal):
    (row,) = (line for line in NOMENCLATURE.splitlines() if line.startswith(f"| `{signal.name}` |"))
    _, _, symbol, unit, _, _, where, _ = (cell.strip() for cell in row.split("|"))
    assert (symbol, unit) == (signal.symbol, signal.unit)
    assert ("in `measurement`" in where) == signal.measured
    assert ("topic" in where) == (signal.topic == signal.name)
