"""Refuse commands that need the ROS graph where ROS is not installed."""

from __future__ import annotations

from importlib import import_module

from bmd_rths_core.errors import InputError

#: Packages of ROS that have to be importable.
_NEEDED = ("rclpy", "diagnostic_msgs", "geometry_msgs", "lifecycle_msgs", "std_srvs", "trajectory_msgs")


def require_ros(command: str) -> None:
    """Refuse a command where ROS cannot be imported.

    Parameters
    ----------
    command : str
        What was asked for, as it stands on the command line.

    Raises
    ------
    InputError
        A package of ROS is missing or does not load; the line says what to install.
    """
    for name in _NEEDED:
        try:
            import_module(name)
        except ImportError as error:
            raise InputError(
                f"{command}: requires ROS 2 ({' '.join(str(error).split())}); "
                "source the setup file of ROS 2 Jazzy, or: pip install 'bmd_rths_nodes[ros]'"
            ) from error
