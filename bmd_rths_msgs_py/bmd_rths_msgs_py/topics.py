"""Every topic of a run: type, frame, who publishes it and who listens."""

from __future__ import annotations

import re
from dataclasses import dataclass

from bmd_rths_core import signals
from bmd_rths_core.errors import InputError

#: Namespace of nodes, topics and services of a test that is given no other one.
NAMESPACE = "/rths"

_NAMESPACE_PATTERN = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")

NUMERICAL_SUBSTRUCTURE = "numerical_substructure"
COMMAND_SHAPER = "command_shaper"
TABLE_DRIVER = "table_driver"
SHEAR_ESTIMATOR = "shear_estimator"
FORCE_CORRECTION = "force_correction"
RECORDER = "recorder"

#: The roles of a run, in the order in which a step passes through them.
ROLES = (NUMERICAL_SUBSTRUCTURE, COMMAND_SHAPER, TABLE_DRIVER, SHEAR_ESTIMATOR, FORCE_CORRECTION, RECORDER)

#: Producer of a topic that every role publishes.
EVERY_ROLE = "all"

ACCELERATION_TYPE = "geometry_msgs/msg/AccelStamped"
FORCE_TYPE = "geometry_msgs/msg/WrenchStamped"
MEASUREMENT_TYPE = "trajectory_msgs/msg/JointTrajectory"
DIAGNOSTICS_TYPE = "diagnostic_msgs/msg/DiagnosticArray"


@dataclass(frozen=True)
class Topic:
    """One topic.

    Parameters
    ----------
    name : str
        Name relative to the namespace of the test; absolute when it begins with ``/``.
    type_name : str
        Message type, for example ``"geometry_msgs/msg/AccelStamped"``.
    producer : str
        Role that publishes it, or `EVERY_ROLE`.
    consumers : tuple of str
        Roles that listen to it. A compensator that owns the numerical substructure listens to the measurement too.
    frame_id : str
        ``header.frame_id`` that this project writes; any other one is read as well.
    description : str
        Content and unit, in one sentence.
    required : bool
        No test begins without a publisher of it.
    """

    name: str
    type_name: str
    producer: str
    consumers: tuple[str, ...]
    frame_id: str
    description: str
    required: bool = True

    @property
    def full_name(self) -> str:
        """Absolute name in the usual namespace, for example ``"/rths/command"``."""
        return self.full_name_in(NAMESPACE)

    def full_name_in(self, namespace: str) -> str:
        """Return the absolute name in a namespace, for example ``"/rig1/command"``.

        Parameters
        ----------
        namespace : str
            As `checked_namespace` returns it.
        """
        return self.name if self.name.startswith("/") else f"{namespace}/{self.name}"


def checked_namespace(text: str) -> str:
    """Return a namespace as ROS has it, with the slash in front.

    Parameters
    ----------
    text : str
        For example ``"rig1"`` or ``"/laboratory/rig1"``.

    Raises
    ------
    InputError
        ROS does not allow it.
    """
    if not _NAMESPACE_PATTERN.fullmatch(text):
        raise InputError(
            f"namespace {text[:60]!r} is not allowed; letters, digits and _ are, no digit first: rig1, /lab/rig1"
        )
    return f"/{text.removeprefix('/')}"


GROUND_ACCELERATION = Topic(
    "ground_acceleration",
    ACCELERATION_TYPE,
    NUMERICAL_SUBSTRUCTURE,
    (RECORDER,),
    "world",
    "linear.x: ground acceleration a_g [m/s2]",
)
DESIRED_ACCELERATION = Topic(
    "desired_acceleration",
    ACCELERATION_TYPE,
    NUMERICAL_SUBSTRUCTURE,
    (COMMAND_SHAPER, RECORDER),
    "world",
    "linear.x: absolute acceleration of the interface, from Eq. 4 [m/s2]; linear.y: the command [m/s2] where a "
    "compensator owns the numerical substructure, otherwise 0",
)
REQUIRED_FORCE = Topic(
    "required_force",
    FORCE_TYPE,
    NUMERICAL_SUBSTRUCTURE,
    (FORCE_CORRECTION, RECORDER),
    "interface",
    "force.x: left side of Eq. 4 at the interface, m(u''+u_g'') + c u' + k u [N]",
)
COMMAND = Topic(
    "command",
    ACCELERATION_TYPE,
    COMMAND_SHAPER,
    (TABLE_DRIVER, RECORDER),
    "world",
    "linear.x: acceleration command of the table, held over the step [m/s2]",
)
MEASUREMENT = Topic(
    "measurement",
    MEASUREMENT_TYPE,
    TABLE_DRIVER,
    (SHEAR_ESTIMATOR, RECORDER),
    "world",
    "joints table, floor_1 to floor_n, applied_command; one point of positions [m], accelerations [m/s2], effort [N]",
)
INTERFACE_FORCE = Topic(
    "interface_force",
    FORCE_TYPE,
    SHEAR_ESTIMATOR,
    (FORCE_CORRECTION, RECORDER),
    "interface",
    "force.x: estimated interface shear [N]",
)
CORRECTED_FORCE = Topic(
    "corrected_force",
    FORCE_TYPE,
    FORCE_CORRECTION,
    (NUMERICAL_SUBSTRUCTURE, RECORDER),
    "interface",
    "force.x: interface shear fed back to the numerical substructure [N]",
)
WAY_TO_REST_COMMAND = Topic(
    "way_to_rest_command",
    ACCELERATION_TYPE,
    TABLE_DRIVER,
    (RECORDER,),
    "world",
    "linear.x: acceleration command on the way to rest [m/s2]; steps are counted on from those of the test",
    required=False,
)
WAY_TO_REST_MEASUREMENT = Topic(
    "way_to_rest_measurement",
    MEASUREMENT_TYPE,
    TABLE_DRIVER,
    (RECORDER,),
    "world",
    "as measurement, on the way to rest",
    required=False,
)
DIAGNOSTICS = Topic(
    "/diagnostics", DIAGNOSTICS_TYPE, EVERY_ROLE, (RECORDER,), "", "deadlines, latency, limits and state of every node"
)

_SCALARS = {
    topic.name: topic
    for topic in (
        GROUND_ACCELERATION,
        DESIRED_ACCELERATION,
        REQUIRED_FORCE,
        COMMAND,
        INTERFACE_FORCE,
        CORRECTED_FORCE,
    )
}

#: Topics with one number a step, in the order of a step. Each has the name of its signal in a `RunRecord`.
SCALAR_TOPICS = tuple(_SCALARS[name] for name in signals.SCALAR_TOPICS)

#: What follows the last step of a test until the table is at rest. A driver of somebody else need not tell it.
WAY_TO_REST_TOPICS = (WAY_TO_REST_COMMAND, WAY_TO_REST_MEASUREMENT)

#: Every topic by its (relative) name.
TOPICS = {topic.name: topic for topic in (*SCALAR_TOPICS, MEASUREMENT, *WAY_TO_REST_TOPICS, DIAGNOSTICS)}
