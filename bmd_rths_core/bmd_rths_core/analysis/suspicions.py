"""What looks like a slip: numbers in another unit, stories in reverse order. None of it is refused."""

from __future__ import annotations

from collections.abc import Iterator

from bmd_rths_core.config import Config
from bmd_rths_core.structure.config import BuildingConfig

#: Frequencies of a first mode that no building on a shake table has [Hz].
_SLOWEST, _FASTEST = 0.15, 60.0
#: Lightest building that somebody tests on a table of more force than `_SMALL_FORCE` [kg, N].
_LIGHTEST, _SMALL_FORCE = 20.0, 5e3
#: Largest damping ratio without a special device; percent look like more.
_MOST_DAMPING = 0.3
#: Stroke [m] beyond that of any shake table, and force [N] that could not move its specimen with a tenth of g.
_LONGEST_STROKE, _LEAST_ACCELERATION = 2.0, 1.0
#: Ratio of the top story to the first one that looks like stories from the top down.
_REVERSED = 1.2


def suspicions(config: Config) -> list[str]:
    """Return what looks like a mistaken unit or order, a line each.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return [
        *_of_building(config.numerical_substructure, config),
        *_of_building(config.specimen, config),
        *_of_order(config),
        *_of_capacity(config),
        *_of_damping(config),
    ]


def _of_building(section: BuildingConfig, config: Config) -> Iterator[str]:
    name, building = section.SECTION, section.building()
    first = float(building.modes().frequencies[0]) / 6.283185307179586
    light = building.total_mass < _LIGHTEST and (config.rig.force or _SMALL_FORCE) >= _SMALL_FORCE
    stiffness = f"{section.stiffnesses[0]:g} N/m" if section.stiffnesses else "K"
    if light:
        yield (
            f"{name}.masses: {building.total_mass:g} kg in all looks like t; multiply masses by 1000 "
            f"(and stiffnesses, if {stiffness} is kN/m)"
        )
    elif first > _FASTEST:
        yield f"{name}: first mode at {first:.3g} Hz; masses look like t, or stiffnesses are too large"
    if first < _SLOWEST and not light:
        yield f"{name}.stiffnesses: first mode at {first:.3g} Hz, {1.0 / first:.3g} s; {stiffness} looks like kN/m"


def _of_order(config: Config) -> Iterator[str]:
    for section in (config.numerical_substructure, config.specimen):
        stiffnesses, masses = section.stiffnesses, section.masses
        if len(stiffnesses) < 2:
            continue
        stiffer = stiffnesses[-1] > _REVERSED * stiffnesses[0]
        # A control layer is softer than what stands on it, so a specimen has to be heavier at the top too.
        heavier = masses[-1] > _REVERSED * masses[0]
        if stiffer and (heavier or section is config.numerical_substructure):
            yield (
                f"{section.SECTION}: the top story has {stiffnesses[-1]:g} N/m, the first one {stiffnesses[0]:g} N/m; "
                "they look like stories from the top down, and are read from the bottom up"
            )


def _of_capacity(config: Config) -> Iterator[str]:
    rig, mass = config.rig, config.specimen.building().total_mass
    if rig.stroke > _LONGEST_STROKE:
        yield f"rig.stroke: {rig.stroke:g} m looks like mm; {1e-3 * rig.stroke:g} m would be that"
    elif not rig.stroke and config.safety.displacement_limit > _LONGEST_STROKE:
        limit = config.safety.displacement_limit
        yield f"safety.displacement_limit: {limit:g} m looks like mm; {1e-3 * limit:g} m would be that"
    if rig.force and rig.force < _LEAST_ACCELERATION * mass:
        force = f"{rig.force:g} N on a specimen of {mass:g} kg"
        yield f"rig.force: {force} looks like kN; {1e3 * rig.force:g} N would be that"


def _of_damping(config: Config) -> Iterator[str]:
    told = {
        "numerical_substructure.damping_ratios": config.numerical_substructure.damping_ratios,
        "specimen.damping_ratios": config.specimen.damping_ratios,
        "nonlinear.damping_ratios": config.nonlinear.damping_ratios,
        "specimen.identified_damping_ratio": (config.specimen.identified_damping_ratio,),
    }
    for name, ratios in told.items():
        largest = max(ratios, default=0.0)
        if largest > _MOST_DAMPING:
            yield f"{name}: {largest:g} looks like percent; {1e-2 * largest:g} would be {largest:g} %"
    for section in (config.numerical_substructure, config.specimen):
        first = float(section.building().modes().damping_ratios[0])
        if not section.damping_ratios and first > _MOST_DAMPING:
            yield f"{section.SECTION}: the first mode has {first:.1%} of critical damping; damping looks too large"
