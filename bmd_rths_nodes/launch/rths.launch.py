"""One test: the five nodes of the loop, and the recorder. The nodes start themselves; Ctrl-C ends them in order."""

import os

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from bmd_rths_msgs_py.topics import NAMESPACE, checked_namespace
from bmd_rths_nodes.roles import COMPOSED_LOOP, LOOP, ROLES

PACKAGE = "bmd_rths_nodes"

#: Parameter that each optional launch argument overrides.
OVERRIDES = {
    "scheme": "run.scheme",
    "motion": "ground_motion.record",
    "component": "ground_motion.component",
    "table": "table.controller",
}

#: Choices of a launch argument that switches something.
SWITCH = ["true", "false"]

#: Exit status of a node that does not accept its parameters.
REFUSED = 2


def generate_launch_description() -> LaunchDescription:
    """Describe the test."""
    config = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "simplified_bmd.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", default_value=config, description="Parameter file of all nodes"),
            DeclareLaunchArgument("scheme", default_value="", description="uc, fc, plc or plc_fc"),
            DeclareLaunchArgument("motion", default_value="", description="Name or file of the ground motion"),
            DeclareLaunchArgument("component", default_value="", description="Component of a motion with several"),
            DeclareLaunchArgument("table", default_value="", description="Table controller, or udp://HOST:PORT"),
            DeclareLaunchArgument(
                "record", default_value="true", choices=SWITCH, description="Record the test into a bag"
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value=NAMESPACE,
                description="Of nodes and topics: each rig has its own",
            ),
            DeclareLaunchArgument("output", default_value="", description="Folder the bag is written into"),
            DeclareLaunchArgument(
                "duration", default_value="", description="Length of the ground motion that is run, from its begin [s]"
            ),
            DeclareLaunchArgument(
                "lockstep",
                default_value="false",
                choices=SWITCH,
                description="Start each step when the last one has closed, as fast as it goes",
            ),
            DeclareLaunchArgument(
                "autostart",
                default_value="true",
                choices=SWITCH,
                description="Configure and activate the nodes; without, the laboratory does, node by node",
            ),
            DeclareLaunchArgument(
                "exit_when_done",
                default_value="false",
                choices=SWITCH,
                description="End the nodes when the test has ended, the table is at rest and the bag is closed",
            ),
            DeclareLaunchArgument(
                "composed",
                default_value="false",
                choices=SWITCH,
                description="The five nodes of the loop in one process, which closes a step several times as fast",
            ),
            DeclareLaunchArgument(
                "sigterm_timeout",
                default_value="30",
                description="Time from Ctrl-C to SIGTERM, and 5 s more to SIGKILL [s]: longer than the way to rest",
            ),
            OpaqueFunction(function=_nodes),
        ]
    )


def _nodes(context: LaunchContext) -> list[Node]:
    given = context.launch_configurations
    for name in ("sigterm_timeout", "duration"):
        _check_seconds(name, given[name])
    record = given["record"] == "true"
    texts = {name: given[key] for key, name in OVERRIDES.items() if given[key]}
    if "://" in given["table"]:
        texts |= {"table.controller": "udp", "table.address": given["table"]}
    overrides = {name: ParameterValue(text, value_type=str) for name, text in texts.items()}
    if given["duration"]:
        overrides["ground_motion.duration"] = float(given["duration"])
    if given["output"]:
        # A relative folder is one of the person, not of wherever a node runs.
        overrides["recorder.directory"] = ParameterValue(os.path.abspath(given["output"]), value_type=str)
    switches = {"run.record": record, **{name: given[name] == "true" for name in ("autostart", "exit_when_done")}}
    if given["lockstep"] == "true":  # without, the file decides
        switches["run.lockstep"] = True
    parameters = [given["config"], {**overrides, **switches}]
    loop = [COMPOSED_LOOP] if given["composed"] == "true" else [role.name for role in LOOP]
    others = [role.name for role in ROLES.values() if role not in LOOP]
    return [
        Node(
            package=PACKAGE,
            executable=name,
            namespace=checked_namespace(given["namespace"]),
            parameters=parameters,
            output="screen",
            on_exit=_on_exit_of(name),
        )
        for name in (*loop, *(others if record else []))
    ]


def _check_seconds(name: str, text: str) -> None:
    """Refuse what is no time before anything is started."""
    try:
        float(text or 0.0)
    except ValueError:
        raise ValueError(f"{name}: {text!r} is not a number of seconds") from None


def _on_exit_of(name: str):
    """Return what the exit of a node means for the others, and for the exit status of the launch.

    The numerical substructure is the clock of the test and tells how it ended, so only its exit ends the others. A
    node that did not even start is the exception: the others would wait for it without end. Launch knows one way to
    an exit status that is not 0: an error, which ends the others as a shutdown does.
    """

    def on_exit(event, context):
        started = event.returncode != REFUSED
        if started and name not in (LOOP[0].name, COMPOSED_LOOP):
            return None
        if event.returncode and not context.is_shutdown:
            raise RuntimeError(f"{name} ended with status {event.returncode}; the test did not finish")
        return Shutdown(reason=f"{name} ended")

    return on_exit
