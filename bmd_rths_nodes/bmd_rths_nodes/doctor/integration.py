"""What one integration of the numerical substructure costs on this computer, and whether it is in time."""

from __future__ import annotations

import statistics
import time

from bmd_rths_core.config import Config
from bmd_rths_core.integration.substeps import WARNED_PART, longest_integration, substeps_for
from bmd_rths_core.loop.build import make_numerical_substructure
from bmd_rths_core.run_config import LONGEST_STEP
from bmd_rths_nodes.doctor.finding import GOOD, PROBLEM, WARNING, Finding

#: Integrations that are measured at least, and for how long at most beyond them [s].
_LEAST, _LONGEST = 9, 0.3


def integration_time(config: Config) -> float:
    """Return the processor time of one integration [s]: the median over some, near rest.

    Parameters
    ----------
    config : Config
        The whole configuration, whose compensator does not integrate itself.
    """
    model = make_numerical_substructure(config)
    model.reset()
    force = 1e-6 * config.numerical_substructure.building().interface_mass
    costs: list[float] = []
    begin = time.perf_counter()
    while len(costs) <= _LEAST or time.perf_counter() - begin < _LONGEST:
        before = time.thread_time()
        model.step(1e-6, force)
        costs.append(time.thread_time() - before)
        force = -force
    return statistics.median(costs[1:])


def judged(config: Config, duration: float) -> tuple[str, str, str]:
    """Return the level of an integration of some duration [s], what was found, and what to change.

    Parameters
    ----------
    config : Config
        The whole configuration.
    duration : float
        Of one integration [s].
    """
    substeps, time_step = config.numerical_substructure.substeps, config.run.time_step
    longest = longest_integration(substeps, time_step)
    whole = substeps * time_step
    steps = f"a step of {time_step:g} s" if substeps == 1 else f"{substeps} steps of {time_step:g} s"
    found = f"one integration takes {1e3 * duration:.3g} ms, {100.0 * duration / whole:.0f} % of {steps}"
    if duration <= WARNED_PART * longest:
        return GOOD, found, ""
    enough = substeps_for(duration, time_step, LONGEST_STEP)
    advice = "fewer stories or a longer run.time_step"
    if enough is not None:
        advice = f"numerical_substructure.substeps={enough} leaves it enough time"
    if duration <= longest:
        return WARNING, found, advice
    return PROBLEM, f"{found}; at most {100.0 * longest / whole:.0f} % is allowed", advice


def integration_finding(config: Config) -> Finding:
    """Measure and judge the integration of a configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return Finding("integration", *judged(config, integration_time(config)))
