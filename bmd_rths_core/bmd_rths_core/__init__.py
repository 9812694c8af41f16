"""Real-time hybrid simulation of a building mass damper on a shake table: the numerical core, without ROS.

This is the front door; each name is imported when it is first used. A whole test in process::

    from bmd_rths_core import RthsLoop, load_config, run_metrics, select_ground_motion

    config = load_config("config/simplified_bmd.yaml").changed(run__scheme="plc_fc")
    motion = select_ground_motion(config.ground_motion, config.run.time_step)
    record = RthsLoop(config, motion).run()
    print(record.outcome, run_metrics(record).rmse_percent)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bmd_rths_core.version import __version__

if TYPE_CHECKING:
    from bmd_rths_core.analysis.metrics import run_metrics
    from bmd_rths_core.analysis.preflight import predict_test
    from bmd_rths_core.config import Config, load_config
    from bmd_rths_core.errors import InputError
    from bmd_rths_core.ground_motion.config import select_ground_motion
    from bmd_rths_core.ground_motion.library import read_ground_motion
    from bmd_rths_core.ground_motion.motion import GroundMotion
    from bmd_rths_core.loop.rths_loop import RthsLoop
    from bmd_rths_core.record import RunRecord
    from bmd_rths_core.stability.assessment import assess

__all__ = [
    "Config",
    "GroundMotion",
    "InputError",
    "RthsLoop",
    "RunRecord",
    "__version__",
    "assess",
    "load_config",
    "predict_test",
    "read_ground_motion",
    "run_metrics",
    "select_ground_motion",
]

#: Where each name comes from: numpy and scipy are imported by the first that needs them.
_MODULE_OF = {
    "Config": "config",
    "GroundMotion": "ground_motion.motion",
    "InputError": "errors",
    "RthsLoop": "loop.rths_loop",
    "RunRecord": "record",
    "assess": "stability.assessment",
    "load_config": "config",
    "predict_test": "analysis.preflight",
    "read_ground_motion": "ground_motion.library",
    "run_metrics": "analysis.metrics",
    "select_ground_motion": "ground_motion.config",
}


def __getattr__(name: str) -> Any:
    """Import a name of the front door."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    return value


def __dir__() -> list[str]:
    """List the front door too before anything of it was used."""
    return sorted({*globals(), *__all__})
