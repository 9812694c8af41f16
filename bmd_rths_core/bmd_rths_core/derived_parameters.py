"""Parameters that follow from others: filled in where nobody gives them, let go where what they follow from changes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bmd_rths_core.parameters import build_section
from bmd_rths_core.run_config import RunConfig
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructureConfig
from bmd_rths_core.structure.config import MATRICES, NO_FILE, STORIES
from bmd_rths_core.table.emulated.config import VirtualControllerConfig
from bmd_rths_core.table.models.servo_hydraulic import ServoHydraulicConfig
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig
from bmd_rths_core.table.models.specimen import SpecimenConfig
from bmd_rths_core.table.rig import RigConfig

Sections = dict[str, Any]


def completed(mapping: Mapping[str, Any]) -> Sections:
    """Return a configuration with what follows from the parameters it gives.

    Parameters
    ----------
    mapping : Mapping
        Section name to parameter name to value, as a person gave it.

    Returns
    -------
    dict
        The same, and more.

    Raises
    ------
    InputError
        A parameter that others follow from is wrong.
    """
    sections: Sections = dict(mapping)
    for section, values in _of_rig(mapping).items():
        given = sections.get(section, {})
        if values and isinstance(given, Mapping):
            sections[section] = {**values, **given}
    _mode_of_the_stories(sections)
    _emulated_as_measured(sections)
    _answered_within_the_step(sections)
    return sections


def _answered_within_the_step(sections: Sections) -> None:
    """Let the emulator answer at the same share of a shorter time step."""
    step, given = _time_step(sections), sections.get(VirtualControllerConfig.SECTION, {})
    if step != RunConfig.time_step and isinstance(given, Mapping):
        sections[VirtualControllerConfig.SECTION] = {"answer_after": _answer_after(step), **given}


def _time_step(sections: Mapping[str, Any]) -> float:
    run = sections.get(RunConfig.SECTION)
    step = run.get("time_step") if isinstance(run, Mapping) else None
    return step if isinstance(step, float) and 0.0 < step < 1.0 else RunConfig.time_step


def _answer_after(time_step: float) -> float:
    share = min(1.0, time_step / RunConfig.time_step)
    return float(f"{VirtualControllerConfig.answer_after * share:.9g}")


def _emulated_as_measured(sections: Sections) -> None:
    """Let the emulator have the measured table, where there is one."""
    table, given = sections.get(SimulatedTableConfig.SECTION), sections.get(VirtualControllerConfig.SECTION, {})
    if isinstance(table, Mapping) and table.get("dynamics") == "measured" and isinstance(given, Mapping):
        sections[VirtualControllerConfig.SECTION] = {"model": "servo", **given}


def _mode_of_the_stories(sections: Sections) -> None:
    """Let the identified mode of another specimen than that of the paper be that of its stories."""
    given, paper = sections.get(SpecimenConfig.SECTION), SpecimenConfig()
    if not isinstance(given, Mapping):
        return
    stories = [key for key in STORIES[:2] if isinstance(given.get(key), (list, tuple))]
    by_matrices = given.get("matrices", NO_FILE) != NO_FILE or bool(given.get("stiffness_matrix"))
    if by_matrices or any(list(given[key]) != list(getattr(paper, key)) for key in stories):
        mode = {"identified_frequency": 0.0, "identified_damping_ratio": 0.0}
        sections[SpecimenConfig.SECTION] = {**mode, **given}


def released(whole: Mapping[str, Any], given: Mapping[str, Any], defaults: Mapping[str, Any]) -> Sections:
    """Return a whole configuration without what has to follow anew from other parameters that are given.

    Parameters
    ----------
    whole : Mapping
        Section name to parameter name to value, all of them.
    given : Mapping
        What is about to be changed.
    defaults : Mapping
        The configuration that is given by nothing.

    Returns
    -------
    dict
        A copy of `whole`. A value that somebody chose stays, unless it is what followed before.
    """
    sections: Sections = {name: dict(values) for name, values in whole.items()}
    if RigConfig.SECTION in given and isinstance(given[RigConfig.SECTION], Mapping):
        before = _of_rig(whole)
        after = _of_rig({**whole, RigConfig.SECTION: {**whole[RigConfig.SECTION], **given[RigConfig.SECTION]}})
        for section in after:
            for key in {*before[section], *after[section]}:
                followed = before[section].get(key, defaults[section][key])
                if sections[section][key] == followed:
                    del sections[section][key]
    emulated, run = sections[VirtualControllerConfig.SECTION], given.get(RunConfig.SECTION)
    if isinstance(run, Mapping) and "time_step" in run and emulated["answer_after"] == _answer_after(_time_step(whole)):
        del emulated["answer_after"]
    for section in (NumericalSubstructureConfig.SECTION, SpecimenConfig.SECTION):
        changed = given.get(section)
        if isinstance(changed, Mapping):
            for key in _of_another_building(changed):
                if key not in changed:
                    del sections[section][key]
    table = given.get(SimulatedTableConfig.SECTION)
    if isinstance(table, Mapping) and "frequency_response" in table:
        for key in ("sections", "command_delay", "fit_error"):
            if key not in table:
                del sections[SimulatedTableConfig.SECTION][key]
    return sections


def _of_another_building(changed: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what belongs to the building that another file of matrices, or other stories, take the place of."""
    if "matrices" in changed:
        return (*MATRICES, *STORIES)
    return ("matrices", *MATRICES) if "stiffnesses" in changed else ()


def _of_rig(mapping: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    values = mapping.get(RigConfig.SECTION)
    rig = build_section(RigConfig, values) if isinstance(values, Mapping) else RigConfig()
    hydraulic = mapping.get(ServoHydraulicConfig.SECTION)
    pressure = hydraulic.get("supply_pressure") if isinstance(hydraulic, Mapping) else None
    if isinstance(pressure, (int, float)) and not isinstance(pressure, bool) and pressure > 0.0:
        return rig.derived(pressure)
    return rig.derived()
