"""Compensators by name: those of this package, and those that others register as entry points.

A module of this package with a tuple `COMPENSATORS` is found by itself. A third party names a `Compensator` in the
entry-point group `bmd_rths.compensators` of its package.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from importlib.metadata import entry_points

from bmd_rths_core import compensators as package
from bmd_rths_core.compensators.protocol import Compensator
from bmd_rths_core.errors import InputError

GROUP = "bmd_rths.compensators"

#: Modules that define what compensators are, and none of their own.
_FRAME = ("protocol", "registry", "schemes")
#: The schemes of the paper come first.
_FIRST = ("phase_lead",)


@functools.cache
def compensators() -> Mapping[str, Compensator]:
    """Return every compensator by its name: the paper's, the others of this package, those of third parties.

    Raises
    ------
    InputError
        Two have one name, or an entry point is no compensator; the entry point is named.
    """
    names = sorted(module.name for module in pkgutil.iter_modules(package.__path__) if module.name not in _FRAME)
    found: dict[str, Compensator] = {}
    for name in sorted(names, key=lambda name: name not in _FIRST):
        module = importlib.import_module(f"{package.__name__}.{name}")
        found |= {entry.name: entry for entry in getattr(module, "COMPENSATORS", ())}
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        entry = point.load()
        if not isinstance(entry, Compensator):
            raise InputError(f"entry point {point.name} of {GROUP}: {point.value} is no Compensator")
        if entry.name in found:
            raise InputError(f"entry point {point.name} of {GROUP}: there is a compensator {entry.name!r} already")
        found[entry.name] = entry
    return found


def compensator(name: str) -> Compensator:
    """Return a compensator by its name.

    Parameters
    ----------
    name : str
        Of configuration and command line.

    Raises
    ------
    InputError
        There is none with this name.
    """
    try:
        return compensators()[name]
    except KeyError:
        raise InputError(
            f"run.scheme: {name!r} is not allowed; one of {', '.join(compensators())} is required"
        ) from None


def settings_sections() -> dict[str, type]:
    """Return the sections of all compensators by name, each once."""
    sections = (entry.settings for entry in compensators().values() if entry.settings is not None)
    return {section.SECTION: section for section in sections}  # type: ignore[attr-defined]
