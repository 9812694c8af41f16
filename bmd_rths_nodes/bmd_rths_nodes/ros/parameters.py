"""ROS parameters derived from the configuration sections: types, ranges, descriptions and units."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from bmd_rths_core.config import SECTIONS, Config, config_from_mapping
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import ParameterSpec, specs

#: Parameters a ROS node may have that are not part of the configuration.
NODE_PARAMETERS = ("autostart", "exit_when_done", "use_sim_time", "start_type_description_service")


def read_configuration(node: Node) -> Config:
    """Return the configuration given to a node by parameter file and command line.

    Parameters
    ----------
    node : Node
        A node whose configuration parameters are not declared yet.

    Returns
    -------
    Config
        The whole configuration, not only the sections of this node.

    Raises
    ------
    InputError
        A parameter is unknown or its value is not allowed.
    """
    mapping: dict[str, dict[str, Any]] = {}
    # rclpy has no public way to see overrides that are not declared, and declaring them unseen fails on empty arrays.
    for name, override in node._parameter_overrides.items():
        _refuse_unsupported(name, override.value)
        if name in NODE_PARAMETERS:
            continue
        section, _, key = name.partition(".")
        if section in SECTIONS and not key:
            raise InputError(f"{name}: {override.value!r} is not a section; parameters with values are required")
        mapping.setdefault(section, {})[key] = _plain(override)
    config = config_from_mapping(mapping)
    if config.simulated_table.dynamics != "measured" or config.simulated_table.sections:
        return config
    from bmd_rths_core.identification.measured_table import with_fitted_table  # few have to wait for it

    return with_fitted_table(config)


def refuse_other_name(node: Node, name: str) -> None:
    """Refuse a node whose name was changed, or that has no namespace: the others look for it below its own name.

    Parameters
    ----------
    node : Node
        The node.
    name : str
        The name it has to have, without its namespace.

    Raises
    ------
    InputError
        It has another one.
    """
    if node.get_name() != name:
        raise InputError(
            f"__node: {node.get_name()} is not supported, {name} is required; "
            "__ns:=/rig1 gives a rig a namespace of its own, so that several share one network"
        )
    if node.get_namespace() == "/":
        raise InputError("__ns: / is not supported; a namespace of its own is required for each rig, as in /rig1")


def declare_configuration(node: Node, config: Config, sections: Iterable[str] | None) -> None:
    """Declare the parameters of some sections with their resolved values.

    Parameters
    ----------
    node : Node
        The node.
    config : Config
        Resolved configuration.
    sections : iterable of str, optional
        Names of the sections this node uses; all of them by default.
    """
    for section in SECTIONS if sections is None else sections:
        values = config.as_mapping()[section]
        for key, spec in specs(SECTIONS[section]).items():
            value = values[key]
            descriptor = _descriptor(spec, value)
            parameter_type = Parameter.Type.DOUBLE_ARRAY if isinstance(value, list) else None
            default = Parameter(f"{section}.{key}", parameter_type, value).value
            node.declare_parameter(f"{section}.{key}", default, descriptor, ignore_override=True)


def changed_configuration(config: Config, parameters: Iterable[Parameter]) -> Config:
    """Return the configuration with some ROS parameters changed.

    Parameters
    ----------
    config : Config
        The configuration so far.
    parameters : iterable of Parameter
        New values; those that are not part of the configuration are left out.

    Returns
    -------
    Config
        The validated configuration.

    Raises
    ------
    InputError
        A value is not allowed.
    """
    changes = {p.name.replace(".", "__", 1): _plain(p) for p in parameters if p.name.partition(".")[0] in SECTIONS}
    return config.changed(**changes)


def refuse_unsupported(parameters: Iterable[Parameter]) -> None:
    """Refuse what ROS nodes can usually be told and these cannot.

    Parameters
    ----------
    parameters : iterable of Parameter
        New values.

    Raises
    ------
    InputError
        One of them is not supported.
    """
    for parameter in parameters:
        _refuse_unsupported(parameter.name, parameter.value)


def _refuse_unsupported(name: str, value: object) -> None:
    if name == "use_sim_time" and value:
        raise InputError("use_sim_time: true is not supported, a table moves by the clock of its computer; false is")
    if name.startswith("qos_overrides."):
        raise InputError(f"{name}: not supported; every topic has the quality of service that the loop needs")


def _plain(parameter: Parameter) -> object:
    """Return the value of a parameter as YAML would give it; ROS knows an empty array only as 'not set'."""
    if parameter.type_ == Parameter.Type.NOT_SET:
        return []
    value = parameter.value
    is_array = not isinstance(value, (str, bytes)) and hasattr(value, "__len__")
    return list(value) if is_array else value


def _descriptor(spec: ParameterSpec, value: object) -> ParameterDescriptor:
    unit = f" [{spec.unit}]" if spec.unit else ""
    source = f" Source: {spec.source}." if spec.source else ""
    descriptor = ParameterDescriptor(
        description=f"{spec.description}{unit}.{source}",
        additional_constraints="" if isinstance(value, bool) else spec.allowed(),
    )
    lowest = -sys.float_info.max if spec.lower is None else spec.lower
    highest = sys.float_info.max if spec.upper is None else spec.upper
    if isinstance(value, float):
        descriptor.floating_point_range = [FloatingPointRange(from_value=lowest, to_value=highest, step=0.0)]
    elif isinstance(value, int) and not isinstance(value, bool):
        descriptor.integer_range = [IntegerRange(from_value=int(lowest), to_value=int(highest), step=1)]
    return descriptor
