"""filterpy without scipy.stats, which takes a second to load and which filterpy needs for likelihoods only."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

_STATS = "scipy.stats"

#: What filterpy takes from there.
_TAKEN = ("norm", "multivariate_normal")

#: What else it takes from scipy; loaded before, so that nobody else gets what stands in for scipy.stats.
_OTHERS = ("scipy.linalg", "scipy.sparse", "scipy.sparse.linalg", "scipy.ndimage")


class _Later:
    """A distribution of scipy.stats, loaded when it is used."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        stats = import_module(_STATS)
        if isinstance(stats, _StandingIn):  # filterpy tries whether scipy is older than 0.14
            return lambda *arguments, **named: None
        return getattr(getattr(stats, self._name), attribute)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return getattr(import_module(_STATS), self._name)(*arguments, **named)


class _StandingIn(ModuleType):
    """In the place of scipy.stats."""


def kalman_filter_class() -> type[KalmanFilter]:
    """Return `filterpy.kalman.KalmanFilter`; scipy.stats is loaded when a likelihood is asked for."""
    with _stats_later():
        loaded: type[KalmanFilter] = import_module("filterpy.kalman").KalmanFilter
    return loaded


@contextmanager
def _stats_later() -> Iterator[None]:
    """Let something else stand in for scipy.stats while filterpy is loaded."""
    if _STATS in sys.modules or "filterpy.kalman" in sys.modules:
        yield
        return
    for name in _OTHERS:
        import_module(name)
    if _STATS in sys.modules:
        yield
        return
    standing_in = _StandingIn(_STATS)
    for name in _TAKEN:
        setattr(standing_in, name, _Later(name))
    sys.modules[_STATS] = standing_in
    try:
        yield
    finally:
        del sys.modules[_STATS]
