"""Real-time hybrid simulation of a building mass damper on a shake table: the numerical core, without ROS."""

from bmd_rths_core.version import __version__

__all__ = ["__version__"]
