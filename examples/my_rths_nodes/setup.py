"""Two executables for `ros2 run my_rths_nodes`, and a table for `bmd-rths run --table my_table`."""

from glob import glob

from setuptools import setup

NAME = "my_rths_nodes"

setup(
    name=NAME,
    version="0.1.0",
    description="A shear estimator and a table driver of your own, for a test of bmd_rths",
    license="Apache-2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        # `ros2 run` looks for executables here, after pip and after colcon.
        (f"lib/{NAME}", sorted(glob("scripts/*"))),
    ],
    entry_points={
        "bmd_rths.table_controllers": [f"my_table = {NAME}.my_table:MyTable"],
    },
    install_requires=["bmd_rths_nodes"],
)
