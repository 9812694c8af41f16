"""What was understood of a configuration, in the quantities an engineer knows it by."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bmd_rths_core.analysis.preflight import Preflight
from bmd_rths_core.analysis.suspicions import suspicions
from bmd_rths_core.compensators.schemes import PHASE_LEAD
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.as_run import GroundPeaks, MotionAsRun
from bmd_rths_core.stability.discrete import configured_mass_ratio, with_feedback_scale
from bmd_rths_core.stability.models import simulated_table
from bmd_rths_core.structure.config import NO_FILE, BuildingConfig
from bmd_rths_core.structure.linear_building import LinearBuilding

#: Band over which the delay of a table is told [Hz].
DELAY_BAND = (0.5, 8.0)

#: Difference of the delay of the table and the lead of the compensator that is told [s].
_DELAY_APART = 0.003


class Range(NamedTuple):
    """Capacity, interlock and limit of one quantity.

    Parameters
    ----------
    quantity, unit : str
    capacity : float
        Of the table; 0 where it is not told.
    interlock : float
        Of the emulated controller.
    limit : float
        Of the supervisor.
    """

    quantity: str
    unit: str
    capacity: float
    interlock: float
    limit: float


def ranges(config: Config) -> tuple[Range, ...]:
    """Return what the table can do beside what it may do.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    rig, own, safety = config.rig, config.virtual_controller, config.safety
    return (
        Range("displacement", "m", rig.stroke, own.displacement_limit, safety.displacement_limit),
        Range("velocity", "m/s", rig.velocity, own.velocity_limit, safety.velocity_limit),
        Range("acceleration", "m/s2", rig.acceleration, own.acceleration_limit, safety.acceleration_limit),
        Range("force", "N", rig.force, own.force_limit, safety.force_limit),
    )


def table_delay(config: Config) -> float:
    """Return the delay of the table model: slope of its phase through the origin over `DELAY_BAND`, weighted by ω [s].

    Parameters
    ----------
    config : Config
        The whole configuration; a measured table is fitted already.
    """
    omega = 2.0 * np.pi * np.linspace(0.02, DELAY_BAND[1], 1600)
    table = simulated_table(config.simulated_table, config.simulated_table.specimen(config.specimen.building()))
    phase = np.unwrap(np.angle(table.response(omega))) - omega * config.simulated_table.command_delay
    inside = omega >= 2.0 * np.pi * DELAY_BAND[0]
    omega, phase = omega[inside], phase[inside]
    return -float(np.sum(omega * phase) / np.sum(omega * omega))


def understanding(config: Config, ran: MotionAsRun, prediction: Preflight | None) -> dict[str, Any]:
    """Return what was understood of a configuration as plain values, with warnings.

    Parameters
    ----------
    config : Config
        The whole configuration; a measured table is fitted already.
    ran : MotionAsRun
        Its ground motion.
    prediction : Preflight, optional
        The test as it is predicted.

    Returns
    -------
    dict
        The object of ``bmd-rths check --json``.
    """
    numerical, specimen = config.elastic_substructure(), config.specimen.building()
    whole = specimen.scaled(config.force_correction.feedback_scale).stacked_on(numerical)
    delay = table_delay(config)
    lead = config.command_shaper.lead_time if config.run.scheme in PHASE_LEAD else None
    table = config.simulated_table
    warnings = [*suspicions(config), *_of_delay(config, delay, lead)]
    told: dict[str, Any] = {
        "time_step_s": config.run.time_step,
        "rate_hz": 1.0 / config.run.time_step,
        "scheme": config.run.scheme,
        "numerical_substructure": _building(config.numerical_substructure, numerical),
        "specimen": _building(config.specimen, specimen),
        "whole_building_hz": (whole.modes().frequencies / (2.0 * np.pi)).tolist(),
        "mass_ratio": configured_mass_ratio(with_feedback_scale(config, 1.0)),
        "mass_ratio_fed_back": configured_mass_ratio(config),
        "feedback_scale": config.force_correction.feedback_scale,
        "shear": config.shear_estimator.source,
        "table": {
            "controller": config.table.controller,
            "dynamics": table.dynamics,
            "frequency_response": None if table.frequency_response == NO_FILE else table.frequency_response,
            "fit_error": table.fit_error if table.dynamics == "measured" else None,
            "platen_mass_kg": table.platen_mass,
            "delay_ms": 1e3 * delay,
            "compensated_ms": None if lead is None else 1e3 * lead,
        },
        "capacity": [{**row._asdict(), "capacity": row.capacity or None} for row in ranges(config)],
        "ground_motion": {
            "name": ran.motion.name,
            "steps": ran.motion.steps,
            "duration_s": ran.motion.duration,
            "time_scale": config.ground_motion.time_scale,
            "scale_factor": ran.scale_factor,
            "recorded": _peaks(ran.recorded),
            "as_run": _peaks(ran.scaled),
        },
    }
    if prediction is not None:
        peaks = prediction.peaks
        told["ground_motion"]["stroke_needed_m"] = peaks.displacement
        told["predicted"] = {
            "displacement_m": peaks.displacement,
            "velocity_m_s": peaks.velocity,
            "command_m_s2": peaks.acceleration,
            "force_n": peaks.force,
            "stability": prediction.verdict,
        }
        warnings += prediction.problems
    return {**told, "warnings": warnings}


def _building(section: BuildingConfig, building: LinearBuilding) -> dict[str, Any]:
    modes = building.modes()
    hertz = modes.frequencies / (2.0 * np.pi)
    given_by = "matrices" if section.stiffness_matrix else "stories"
    if section.matrices != NO_FILE:
        given_by = section.matrices
    return {
        "given_by": given_by,
        "floors": building.stories,
        "mass_kg": building.total_mass,
        "floor_masses_kg": list(building.masses),
        "frequencies_hz": hertz.tolist(),
        "periods_s": (1.0 / hertz).tolist(),
        "damping_ratios": modes.damping_ratios.tolist(),
        "effective_masses_kg": modes.effective_masses.tolist(),
    }


def _peaks(peaks: GroundPeaks) -> dict[str, float]:
    return {
        "pga_m_s2": peaks.acceleration,
        "pgv_m_s": peaks.velocity,
        "pgd_m": peaks.displacement,
        "last_velocity_m_s": peaks.last_velocity,
        "last_displacement_m": peaks.last_displacement,
    }


def _of_delay(config: Config, delay: float, lead: float | None) -> list[str]:
    if lead is None or abs(delay - lead) <= _DELAY_APART:
        return []
    return [
        f"command_shaper.lead_time: the compensator leads by {1e3 * lead:.1f} ms, the table model lags by "
        f"{1e3 * delay:.1f} ms from {DELAY_BAND[0]:g} to {DELAY_BAND[1]:g} Hz"
    ]
