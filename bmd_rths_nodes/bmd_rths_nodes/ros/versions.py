"""Versions of the middleware a test ran on."""

from __future__ import annotations

import os
from importlib.metadata import PackageNotFoundError, version

import rclpy


def ros_versions() -> dict[str, str]:
    """Return distribution, rclpy and middleware of this process.

    Returns
    -------
    dict of str to str
        ``rclpy`` is "unknown" where ROS was installed without package metadata.
    """
    try:
        rclpy_version = version("rclpy")
    except PackageNotFoundError:
        rclpy_version = "unknown"
    return {
        "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
        "rclpy": rclpy_version,
        "rmw": rclpy.get_rmw_implementation_identifier(),
    }
