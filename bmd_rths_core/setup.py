"""Package of the numerical core, for pip and for colcon."""

from setuptools import find_packages, setup

NAME = "bmd_rths_core"

setup(
    name=NAME,
    version="0.1.0",
    description="Numerical core of real-time hybrid simulation on a shake table",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "data/*.csv"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["numpy", "scipy", "filterpy", "PyYAML"],
    extras_require={
        "export": ["h5py", "pyarrow"],
        "plots": ["matplotlib", "fonttools"],
        "obspy": ["obspy"],
        "asdf": ["h5py"],
        "xlsx": ["openpyxl"],
    },
    zip_safe=False,
)
