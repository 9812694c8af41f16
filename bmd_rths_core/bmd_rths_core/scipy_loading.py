"""scipy in two thirds of its time: it copies all that numpy has, and so loads the parts that numpy leaves for later."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np

#: What no node uses.
_UNUSED = ("f2py", "ma", "polynomial", "testing")


def leave_for_later() -> None:
    """Have the unused parts of numpy loaded by who uses them first; to be called before scipy is imported."""
    for part in _UNUSED:
        name = f"numpy.{part}"
        spec = None if name in sys.modules else importlib.util.find_spec(name)
        if spec is None or spec.loader is None:
            continue
        spec.loader = importlib.util.LazyLoader(spec.loader)
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        setattr(np, part, module)
