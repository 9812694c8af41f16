"""Version of the package, kept equal to package.xml and setup.py by a test."""

__version__ = "0.1.0"
