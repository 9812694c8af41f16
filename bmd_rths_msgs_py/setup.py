"""Package of messages and bags, for pip and for colcon."""

from setuptools import find_packages, setup

NAME = "bmd_rths_msgs_py"

setup(
    name=NAME,
    version="0.1.0",
    description="Messages and MCAP bags of real-time hybrid simulation",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "*.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["bmd_rths_core", "numpy", "mcap", "rosbags", "PyYAML"],
    zip_safe=False,
)
