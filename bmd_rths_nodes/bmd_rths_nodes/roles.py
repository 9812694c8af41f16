"""The roles of a run: what launch file, executables, processes, composition and nodes are made from."""

from __future__ import annotations

from dataclasses import dataclass

from bmd_rths_msgs_py.topics import (
    COMMAND_SHAPER,
    EVERY_ROLE,
    FORCE_CORRECTION,
    NUMERICAL_SUBSTRUCTURE,
    RECORDER,
    SHEAR_ESTIMATOR,
    TABLE_DRIVER,
    TOPICS,
    Topic,
)

#: The executable that has every node of the loop in one process.
COMPOSED_LOOP = "composed_loop"


@dataclass(frozen=True)
class Role:
    """One role; its node, its executable and its module in `bmd_rths_nodes.nodes` have its name.

    Parameters
    ----------
    name : str
        For example ``"table_driver"``.
    sections : tuple of str, optional
        Sections of the configuration its node declares as parameters; None for all of them.
    """

    name: str
    sections: tuple[str, ...] | None

    @property
    def module(self) -> str:
        """Module of the node."""
        return module_of(self.name)

    @property
    def publishes(self) -> tuple[Topic, ...]:
        """Topics of the node."""
        return tuple(topic for topic in TOPICS.values() if topic.producer in (self.name, EVERY_ROLE))

    @property
    def hears(self) -> tuple[Topic, ...]:
        """Topics the node listens to."""
        return tuple(topic for topic in TOPICS.values() if self.name in topic.consumers)


def module_of(executable: str) -> str:
    """Return the module that an executable runs.

    Parameters
    ----------
    executable : str
        Name of a role, or `COMPOSED_LOOP`.
    """
    return f"bmd_rths_nodes.nodes.{executable}"


#: The roles of the loop, in the order in which a step passes through them.
LOOP = (
    Role(
        NUMERICAL_SUBSTRUCTURE, ("run", "real_time", "ground_motion", "numerical_substructure", "nonlinear", "safety")
    ),
    Role(COMMAND_SHAPER, ("run", "real_time", "command_shaper")),
    Role(TABLE_DRIVER, ("run", "real_time", "rig", "safety", "table", "simulated_table", "sensors", "specimen")),
    Role(SHEAR_ESTIMATOR, ("run", "real_time", "shear_estimator", "specimen")),
    Role(FORCE_CORRECTION, ("run", "real_time", "force_correction")),
)

#: Every role of a run by its name; the recorder keeps the whole configuration in the bag.
ROLES = {role.name: role for role in (*LOOP, Role(RECORDER, None))}
