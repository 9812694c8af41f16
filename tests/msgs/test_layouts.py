"""The layouts lead to the signals: every path is followed in a real message."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from bmd_rths_core.record import RunRecord
from bmd_rths_core.signals import SIGNALS
from bmd_rths_core.table.controller import TableMeasurement
from bmd_rths_core.time_steps import StepStamps
from bmd_rths_msgs_py.cdr import MeasurementCodec, ScalarCodec
from bmd_rths_msgs_py.layouts import curves_of, foxglove_layout, plotjuggler_layout
from bmd_rths_msgs_py.topics import MEASUREMENT, TOPICS

FLOORS = 3
STEP = 7


@pytest.fixture
def messages(make_record: Callable[..., RunRecord], typestore: Any) -> tuple[RunRecord, dict[str, Any]]:
    """Return a record, and the message of every topic at one step as rosbags reads it."""
    record = make_record(20, floors=FLOORS)
    signals = record.signals()
    found = {}
    for signal in SIGNALS:
        if not signal.measured:
            topic = TOPICS[signal.topic]
            data = ScalarCodec().pack(5_000_000 * STEP, float(signals[signal.name][STEP]))
            found[topic.full_name] = typestore.deserialize_cdr(data, topic.type_name)
    values = (signals[name][STEP] for name in TableMeasurement._fields[1:])
    data = MeasurementCodec(FLOORS, StepStamps(0.005)).pack(5_000_000 * STEP, TableMeasurement(STEP, *values))
    found[MEASUREMENT.full_name] = typestore.deserialize_cdr(data, MEASUREMENT.type_name)
    return record, found


def followed(message: Any, fields: list[str]) -> float:
    for field in fields:
        name, _, index = field.partition("[")
        message = getattr(message, name)
        if index:
            message = message[int(index.rstrip("]"))]
    return float(message)


def test_every_signal_is_where_its_curve_leads(messages: tuple[RunRecord, dict[str, Any]]) -> None:
    record, found = messages
    for signal in SIGNALS:
        expected = record.signals()[signal.name][STEP]
        curves = curves_of(signal, FLOORS)
        values = [followed(found[curve.topic], list(curve.field)) for curve in curves]
        assert values == (expected.tolist() if signal.per_floor else [expected]), signal.name


def expected_paths(separator: str) -> set[str]:
    return {separator.join((c.topic, *c.field)) for signal in SIGNALS for c in curves_of(signal, FLOORS)}


def test_foxglove_shows_every_signal_once_and_both_over_each_other() -> None:
    content = json.loads(foxglove_layout(FLOORS))
    assert content.keys() == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    panels = content["configById"]
    over_time = [panel for panel in panels.values() if panel.get("xAxisVal") == "timestamp"]
    paths = [path["value"] for panel in over_time for path in panel["paths"]]
    assert sorted(paths) == sorted(expected_paths("."))
    (synchronised,) = (panel for panel in panels.values() if panel.get("xAxisVal") == "custom")
    assert synchronised["xAxisPath"]["value"] == "/rths/desired_acceleration.accel.linear.x"
    assert [path["value"] for path in synchronised["paths"]] == ["/rths/measurement.points[0].accelerations[0]"]
    assert sorted(leaves(content["layout"])) == sorted(panels)


def leaves(layout: Any) -> list[str]:
    return [layout] if isinstance(layout, str) else [*leaves(layout["first"]), *leaves(layout["second"])]


def test_plotjuggler_shows_every_signal_once_and_both_over_each_other() -> None:
    root = ElementTree.fromstring(plotjuggler_layout(FLOORS).encode())
    curves = [
        c.get("name") for plot in root.iter("plot") if plot.get("mode") == "TimeSeries" for c in plot.iter("curve")
    ]
    assert sorted(map(str, curves)) == sorted(expected_paths("/"))
    (curve,) = (c for plot in root.iter("plot") if plot.get("mode") == "XYPlot" for c in plot.iter("curve"))
    assert curve.get("curve_x") == "/rths/desired_acceleration/accel/linear/x"
    assert curve.get("curve_y") == "/rths/measurement/points[0]/accelerations[0]"
    for splitter in root.iter("DockSplitter"):
        assert int(str(splitter.get("count"))) == len(splitter) == len(str(splitter.get("sizes")).split(";"))


def test_layouts_of_the_documentation_are_those_of_the_code() -> None:
    folder = Path(__file__).parents[2] / "docs" / "layouts"
    hint = "run: bmd-rths layouts --output docs/layouts"
    assert (folder / "bmd_rths_foxglove.json").read_text(encoding="utf-8") == foxglove_layout(2), hint
    assert (folder / "bmd_rths_plotjuggler.xml").read_text(encoding="utf-8") == plotjuggler_layout(2), hint
    assert not re.search("measurement", foxglove_layout(1).replace("/rths/measurement", ""))
