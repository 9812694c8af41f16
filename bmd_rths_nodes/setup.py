"""Package of nodes, launch file and command line, for pip and for colcon."""

from glob import glob

from setuptools import find_packages, setup

NAME = "bmd_rths_nodes"

setup(
    name=NAME,
    version="0.1.0",
    description="ROS 2 nodes and command line of real-time hybrid simulation on a shake table",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "monitor_page/static/*.*", "monitor_page/static/uplot/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.launch.py"))),
        # `ros2 run` looks for executables here; pip and colcon both take them from this one list.
        (f"lib/{NAME}", sorted(glob("scripts/*"))),
    ],
    entry_points={
        "console_scripts": ["bmd-rths = bmd_rths_nodes.cli.main:main"],
        "ros2doctor.checks": ["BmdRthsCheck = bmd_rths_nodes.doctor.ros2:BmdRthsCheck"],
    },
    install_requires=["bmd_rths_core", "bmd_rths_msgs_py", "click", "matplotlib", "rich", "PyYAML", "tornado"],
    # What needs no graph needs no ROS: it comes from the setup file of a ROS installation, or from these wheels.
    extras_require={
        "cluster": ["distributed"],
        "export": ["h5py", "pyarrow"],
        "foxglove": ["foxglove-sdk"],
        "parquet": ["pyarrow"],
        "ros": ["ros-jazzy-rclpy", "ros-jazzy-common-interfaces", "ros-jazzy-rmw-fastrtps-cpp"],
    },
    zip_safe=False,
)
