"""Layouts for Foxglove, Lichtblick and PlotJuggler, made from the table of signals."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, NamedTuple
from xml.etree import ElementTree

from bmd_rths_core.signals import SIGNALS, Signal
from bmd_rths_msgs_py.topics import DIAGNOSTICS, FORCE_TYPE, NAMESPACE, NUMERICAL_SUBSTRUCTURE, TABLE_DRIVER, TOPICS

#: Okabe and Ito (2008), without black, which a dark background hides.
COLOURS = ("#0072B2", "#D55E00", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#8A6D3B", "#888888")

#: Where in a measurement a signal is, before the number of its joint.
_IN_MEASUREMENT = {
    "table_displacement": ("positions", 0),
    "table_acceleration": ("accelerations", 0),
    "actuator_force": ("effort", 0),
    "base_shear": ("effort", 1),
}

#: Time that a live curve reaches back [s].
_SPAN = 10.0


class Curve(NamedTuple):
    """One signal of a plot.

    Parameters
    ----------
    label : str
        Name for a person.
    topic : str
        Absolute name of its topic.
    field : tuple of str
        Names of the fields that lead to it in a message, each with the number of its element where it is an array.
    """

    label: str
    topic: str
    field: tuple[str, ...]


class Plot(NamedTuple):
    """One panel.

    Parameters
    ----------
    title : str
        Quantity and unit.
    curves : tuple of Curve
        What it shows.
    over_time : bool
        False for the second curve over the first.
    """

    title: str
    curves: tuple[Curve, ...]
    over_time: bool = True


def curves_of(signal: Signal, floors: int, namespace: str = NAMESPACE) -> tuple[Curve, ...]:
    """Return where in the messages a signal is: one curve, or one for every floor.

    Parameters
    ----------
    signal : Signal
        One of `SIGNALS`.
    floors : int
        Number of measured floors.
    namespace : str
        Of the topics.
    """
    topic = TOPICS[signal.topic]
    name = topic.full_name_in(namespace)
    label = signal.name.replace("_", " ")
    if not signal.measured:
        field = ("wrench", "force", "x") if topic.type_name == FORCE_TYPE else ("accel", "linear", "x")
        return (Curve(label, name, field),)
    if signal.per_floor:
        return tuple(Curve(f"floor {i}", name, ("points[0]", f"accelerations[{i}]")) for i in range(1, floors + 1))
    array, joint = _IN_MEASUREMENT.get(signal.name, ("accelerations", floors + 1))  # the last one: applied_command
    return (Curve(label, name, ("points[0]", f"{array}[{joint}]")),)


def plots(floors: int, namespace: str = NAMESPACE) -> list[Plot]:
    """Return what the layouts show: every signal once, and the table over what was desired of it.

    Parameters
    ----------
    floors : int
        Number of measured floors.
    namespace : str
        Of the topics.
    """
    found = {signal.name: curves_of(signal, floors, namespace) for signal in SIGNALS}
    by_unit: dict[str, list[Curve]] = {}
    for signal in SIGNALS:
        if not signal.per_floor:
            by_unit.setdefault(signal.unit, []).extend(found[signal.name])
    synchronised = (*found["desired_acceleration"], *found["table_acceleration"])
    return [
        Plot("Accelerations [m/s²]", tuple(by_unit.pop("m/s²"))),
        Plot("Floors [m/s²]", found["floor_accelerations"]),
        *(Plot(f"{_QUANTITIES.get(unit, unit)} [{unit}]", tuple(curves)) for unit, curves in by_unit.items()),
        Plot("Synchronisation [m/s²]", synchronised, over_time=False),
    ]


_QUANTITIES = {"N": "Forces", "m": "Displacement"}


# ---- Foxglove and Lichtblick


def foxglove_layout(floors: int, namespace: str = NAMESPACE) -> str:
    """Return the layout as JSON, for *Import from file* of Foxglove and Lichtblick.

    Parameters
    ----------
    floors : int
        Number of measured floors.
    namespace : str
        Of topics and nodes.
    """
    panels = {f"Plot!bmd_rths_{i}": _foxglove_plot(plot) for i, plot in enumerate(plots(floors, namespace))}
    for role in (NUMERICAL_SUBSTRUCTURE, TABLE_DRIVER):
        panels[f"DiagnosticStatusPanel!{role}"] = {
            "topicToRender": DIAGNOSTICS.full_name,
            "selectedHardwareId": "bmd_rths",
            "selectedName": f"{namespace}/{role}",
            "foxglovePanelTitle": role.replace("_", " "),
        }
    panels["DiagnosticSummary!bmd_rths"] = {
        "topicToRender": DIAGNOSTICS.full_name,
        "minLevel": 0,
        "pinnedIds": [],
        "hardwareIdFilter": "bmd_rths",
        "foxglovePanelTitle": "nodes",
    }
    names = list(panels)
    wide, narrow = names[:3], names[3:]
    layout = {"direction": "row", "first": _stacked(wide), "second": _stacked(narrow), "splitPercentage": 55}
    content = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": layout,
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _foxglove_plot(plot: Plot) -> dict[str, Any]:
    paths = [
        {
            "timestampMethod": "headerStamp",  # test time
            "value": ".".join((curve.topic, *curve.field)),
            "label": curve.label,
            "color": colour,
            "enabled": True,
        }
        for curve, colour in _coloured(plot.curves)
    ]
    config: dict[str, Any] = {
        "foxglovePanelTitle": plot.title,
        "paths": paths,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "top",
        "showPlotValuesInLegend": False,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
        "followingViewWidth": _SPAN,
    }
    if not plot.over_time:
        x, *paths = paths
        config |= {"xAxisVal": "custom", "xAxisPath": {"value": x["value"], "enabled": True}, "paths": paths}
        del config["followingViewWidth"]
    return config


def _stacked(names: list[str]) -> Any:
    """Return panels one below the other, all of one height."""
    first, *others = names
    if not others:
        return first
    return {
        "direction": "column",
        "first": first,
        "second": _stacked(others),
        "splitPercentage": round(100.0 / len(names), 2),
    }


def _coloured(curves: tuple[Curve, ...]) -> Iterator[tuple[Curve, str]]:
    return ((curve, COLOURS[i % len(COLOURS)]) for i, curve in enumerate(curves))


# ---- PlotJuggler


def plotjuggler_layout(floors: int, namespace: str = NAMESPACE) -> str:
    """Return the layout as XML, for *Load layout* of PlotJuggler.

    Parameters
    ----------
    floors : int
        Number of measured floors.
    namespace : str
        Of the topics.
    """
    root = ElementTree.Element("root")
    window = ElementTree.SubElement(root, "tabbed_widget", {"parent": "main_window", "name": "Main Window"})
    tab = ElementTree.SubElement(window, "Tab", tab_name="bmd_rths", containers="1")
    found = plots(floors, namespace)
    rows = ElementTree.SubElement(ElementTree.SubElement(tab, "Container"), "DockSplitter", _split("|", 2))
    for column in (found[: (len(found) + 1) // 2], found[(len(found) + 1) // 2 :]):
        splitter = ElementTree.SubElement(rows, "DockSplitter", _split("-", len(column)))
        for plot in column:
            _plotjuggler_plot(ElementTree.SubElement(splitter, "DockArea", name=plot.title), plot)
    ElementTree.SubElement(window, "currentTabIndex", index="0")
    ElementTree.SubElement(root, "use_relative_time_offset", enabled="1")
    ElementTree.indent(root, " ")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{ElementTree.tostring(root, encoding='unicode')}\n"


def _split(orientation: str, count: int) -> dict[str, str]:
    return {"orientation": orientation, "count": str(count), "sizes": ";".join([f"{1.0 / count:.6f}"] * count)}


def _plotjuggler_plot(area: ElementTree.Element, plot: Plot) -> None:
    mode, style = ("TimeSeries", "Lines") if plot.over_time else ("XYPlot", "Dots")
    made = ElementTree.SubElement(area, "plot", mode=mode, style=style, flip_x="false", flip_y="false")
    ElementTree.SubElement(made, "limitY")
    names = ["/".join((curve.topic, *curve.field)) for curve in plot.curves]
    if plot.over_time:
        for name, (_, colour) in zip(names, _coloured(plot.curves), strict=True):
            ElementTree.SubElement(made, "curve", name=name, color=colour)
    else:
        x, y = names
        ElementTree.SubElement(made, "curve", name=f"[{x};{y}]", curve_x=x, curve_y=y, color=COLOURS[1])
