"""filterpy without scipy.stats and scipy.ndimage, which take a second to load; its Kalman filter does not use them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

#: What filterpy takes from there, for likelihoods and for discrete Bayes filters.
_TAKEN = {"scipy.stats": ("norm", "multivariate_normal"), "scipy.ndimage": ("convolve", "shift")}

#: What else it takes from scipy; loaded before, so that nobody else gets what stands in for those.
_OTHERS = ("scipy.linalg", "scipy.sparse", "scipy.sparse.linalg")


class _Later:
    """A distribution or function of scipy, loaded when it is used."""

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name

    def __getattr__(self, attribute: str) -> Any:
        module = import_module(self._module)
        if isinstance(module, _StandingIn):  # filterpy tries whether scipy is older than 0.14
            return lambda *arguments, **named: None
        return getattr(getattr(module, self._name), attribute)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return getattr(import_module(self._module), self._name)(*arguments, **named)


class _StandingIn(ModuleType):
    """In the place of a module of scipy."""


def kalman_filter_class() -> type[KalmanFilter]:
    """Return `filterpy.kalman.KalmanFilter`; what else filterpy needs is loaded when it is used."""
    with _the_rest_later():
        loaded: type[KalmanFilter] = import_module("filterpy.kalman").KalmanFilter
    return loaded


@contextmanager
def _the_rest_later() -> Iterator[None]:
    """Let something else stand in for the modules of scipy while filterpy is loaded."""
    if "filterpy.kalman" in sys.modules:
        yield
        return
    for name in _OTHERS:
        import_module(name)
    standing_in = [name for name in _TAKEN if name not in sys.modules]
    for name in standing_in:
        sys.modules[name] = _StandingIn(name)
        for taken in _TAKEN[name]:
            setattr(sys.modules[name], taken, _Later(name, taken))
    try:
        yield
    finally:
        for name in standing_in:
            del sys.modules[name]
