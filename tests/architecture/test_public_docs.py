"""Everything public is documented, parameter by parameter, and the versions agree."""

import ast
import dataclasses
import importlib
import inspect
import pkgutil
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Protocol

import pytest

import bmd_rths_core
import bmd_rths_msgs_py
from bmd_rths_core.parameters import parameter

ROOT = Path(__file__).parents[2]
PACKAGES = ("bmd_rths_core", "bmd_rths_msgs_py", "bmd_rths_nodes")


def modules():
    for package in (bmd_rths_core, bmd_rths_msgs_py):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            yield importlib.import_module(info.name)


def public_objects(namespace, module_name, prefix):
    """Yield qualified name and object of every public function, class, method and property written in a module."""
    for name, member in vars(namespace).items():
        function = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
        written_here = getattr(function, "__module__", None) == module_name and hasattr(function, "__qualname__")
        if name.startswith("_") or not written_here or not (inspect.isfunction(function) or inspect.isclass(function)):
            continue
        yield f"{prefix}.{name}", function
        if inspect.isclass(function):
            yield from public_objects(function, module_name, f"{prefix}.{name}")


def documented_parameters(docstring):
    """Return the names in the 'Parameters' section of a numpydoc docstring."""
    _, _, section = inspect.cleandoc(docstring).partition("Parameters\n----------\n")
    section = re.split(r"\n\n\w[\w ]*\n-+\n", section)[0]
    heads = [line.partition(" : ")[0] for line in section.splitlines() if re.match(r"[\w*]", line)]
    return {name.strip().lstrip("*") for head in heads for name in head.split(",") if name.strip()}


def parameters_of(documented):
    """Return the parameters of a function or class; a field made with `parameter` is described where it is declared."""
    described_fields = set()
    if inspect.isclass(documented):
        constructor = vars(documented).get("__init__")
        if getattr(constructor, "__module__", None) != documented.__module__ and not hasattr(documented, "_fields"):
            return set()  # an enumeration, a protocol, or the constructor of the base class
        if dataclasses.is_dataclass(documented):
            specs = ((field.name, list(field.metadata.values())) for field in dataclasses.fields(documented))
            described_fields = {name for name, spec in specs if spec and spec[0].description}
        documented = documented if hasattr(documented, "_fields") else constructor
    return set(inspect.signature(documented).parameters) - {"self", "cls"} - described_fields


def described_methods(objects):
    """Return name and parameters of every documented method of a protocol: an implementation needs one line only."""
    protocols = [item for item in objects.values() if inspect.isclass(item) and getattr(item, "_is_protocol", False)]
    methods = [method for protocol in protocols for method in vars(protocol).values() if inspect.isfunction(method)]
    return {
        (method.__name__, frozenset(parameters_of(method)))
        for method in methods
        if method.__doc__ and not problems_of(method.__name__, method)
    }


def is_described_elsewhere(documented, described):
    """Tell whether an object is a function with a docstring of one line that implements a method of a protocol."""
    if not inspect.isfunction(documented) or "\n" in (documented.__doc__ or "\n"):
        return False
    return (documented.__name__, frozenset(parameters_of(documented))) in described


def part_of(module):
    """Return the part of the core that a module belongs to, or its package."""
    package, *parts = module.split(".")
    return (package, *parts[: package == "bmd_rths_core"])


def imported_elsewhere():
    """Return module and name of every function that another part of the core, or another package, imports."""
    found = set()
    for package in PACKAGES:
        for path in (ROOT / package / package).rglob("*.py"):
            own = ".".join(path.relative_to(ROOT / package).with_suffix("").parts)
            imports = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom))
            for node in imports:
                if part_of(own) != part_of(node.module or ""):
                    found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def is_of_one_part(name, documented, imported):
    """Tell whether an object is a function with a docstring of one line that no other part imports."""
    return (
        inspect.isfunction(documented)
        and "\n" not in (documented.__doc__ or "\n")
        and is_function_of_module(name, documented)
        and name not in imported
    )


def is_function_of_module(name, documented):
    return name == f"{documented.__module__}.{documented.__name__}"


def problems_of(name, documented):
    docstring = documented.__doc__
    # A dataclass or named tuple without a docstring is given its signature as one.
    if not docstring or docstring.startswith(f"{documented.__name__}("):
        return [f"{name}: no docstring"]
    needed, described = parameters_of(documented), documented_parameters(docstring)
    missing = [f"{name}: parameter {parameter} is not documented" for parameter in sorted(needed - described)]
    unknown = [f"{name}: there is no parameter {parameter}" for parameter in sorted(described - needed)]
    return missing + unknown


def test_everything_public_is_documented():
    found = {name: item for m in modules() for name, item in public_objects(m, m.__name__, m.__name__)}
    assert "bmd_rths_core.stages.numerical_substructure.NumericalSubstructure.step" in found
    assert "bmd_rths_msgs_py.bag_reader.read_bag" in found
    described, imported = described_methods(found), imported_elsewhere()
    assert "bmd_rths_core.config.load_config" in imported
    needed = {
        name: item
        for name, item in found.items()
        if not is_described_elsewhere(item, described) and not is_of_one_part(name, item, imported)
    }
    assert len(needed) < len(found)
    assert [problem for name, item in needed.items() for problem in problems_of(name, item)] == []


class Described(Protocol):
    """A protocol."""

    def draw(self, figure):
        """Draw.

        Parameters
        ----------
        figure : Figure
            Empty.
        """

    def undescribed(self, figure):
        """Leave open what the figure is."""


def test_one_line_is_enough_for_what_a_protocol_describes():
    class Line:
        def draw(self, figure):
            """Draw a line."""

        def undescribed(self, figure):
            """Do something."""

    class Dashes:
        def draw(self, figure, dashes):
            """Draw a line with dashes, which no protocol describes."""

    described = described_methods({"Described": Described})
    assert is_described_elsewhere(Line.draw, described)
    assert not is_described_elsewhere(Line.undescribed, described)
    assert not is_described_elsewhere(Dashes.draw, described)


def test_an_undocumented_argument_is_found():
    def scale(motion, factor, *, peak):
        """Scale a motion.

        Parameters
        ----------
        motion : GroundMotion
            The motion, not the factor : see elsewhere.
        peak, limit : float
            Peak and limit.

        Returns
        -------
        factor : float
        """

    assert problems_of("scale", scale) == [
        "scale: parameter factor is not documented",
        "scale: there is no parameter limit",
    ]


def test_a_field_without_a_description_is_found():
    @dataclasses.dataclass
    class Plain:
        """Without the parameters."""

        mass: float

    @dataclasses.dataclass
    class Section:
        """Described where it is declared."""

        mass: float = parameter(1.0, description="Mass", unit="kg")

    assert problems_of("Plain", Plain) == ["Plain: parameter mass is not documented"]
    assert problems_of("Section", Section) == []


def keyword_of_setup(package, keyword):
    tree = ast.parse((ROOT / package / "setup.py").read_text())
    return next(ast.literal_eval(node.value) for node in ast.walk(tree) if getattr(node, "arg", None) == keyword)


@pytest.mark.parametrize("package", PACKAGES)
def test_versions_agree(package):
    manifest = ElementTree.parse(ROOT / package / "package.xml")
    assert manifest.findtext("version") == bmd_rths_core.__version__
    assert keyword_of_setup(package, "version") == bmd_rths_core.__version__
