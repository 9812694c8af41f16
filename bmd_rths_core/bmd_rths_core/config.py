"""The configuration of a test: every section, read from and written to one YAML file that ROS reads too."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, cast

import yaml

from bmd_rths_core.bounded_yaml import read_yaml
from bmd_rths_core.compensators.phase_lead import CommandShaperConfig
from bmd_rths_core.compensators.protocol import Compensator
from bmd_rths_core.compensators.registry import compensator, settings_sections
from bmd_rths_core.derived_parameters import completed, released
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import GroundMotionConfig
from bmd_rths_core.parameters import build_section, specs, suggestion
from bmd_rths_core.renamed_parameters import refuse_renamed
from bmd_rths_core.run_config import LONGEST_STEP, RealTimeConfig, RecorderConfig, RunConfig
from bmd_rths_core.safety import SafetyConfig
from bmd_rths_core.stages.force_correction import ForceCorrectionConfig
from bmd_rths_core.stages.nonlinear_substructure import NonlinearSubstructure
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructureConfig
from bmd_rths_core.stages.shear_estimator import ShearEstimatorConfig
from bmd_rths_core.structure.config import NO_FILE
from bmd_rths_core.structure.linear_building import LinearBuilding
from bmd_rths_core.structure.nonlinear_building import NonlinearConfig, elastic_building
from bmd_rths_core.table.calibration import SensorsConfig
from bmd_rths_core.table.config import TableConfig
from bmd_rths_core.table.emulated.config import VirtualControllerConfig
from bmd_rths_core.table.models.identified import IdentifiedModelConfig
from bmd_rths_core.table.models.servo_hydraulic import ServoHydraulicConfig
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig
from bmd_rths_core.table.models.specimen import SpecimenConfig
from bmd_rths_core.table.rig import RigConfig
from bmd_rths_core.verdict_bands import VerdictConfig


@dataclass(frozen=True)
class Config:
    """The whole configuration, one section a field; the defaults are the simplified BMD of the paper.

    Parameters
    ----------
    run, rig, ground_motion, numerical_substructure, nonlinear, specimen, command_shaper, safety, table,
    simulated_table, sensors, virtual_controller, servo_hydraulic, identified_model, shear_estimator, force_correction,
    recorder, real_time, verdict
        See the section classes.
    compensation : tuple
        The sections of the other compensators, as the registry finds them; in a file they stand beside the others.
    """

    run: RunConfig = dataclasses.field(default_factory=RunConfig)
    rig: RigConfig = dataclasses.field(default_factory=RigConfig)
    ground_motion: GroundMotionConfig = dataclasses.field(default_factory=GroundMotionConfig)
    numerical_substructure: NumericalSubstructureConfig = dataclasses.field(default_factory=NumericalSubstructureConfig)
    nonlinear: NonlinearConfig = dataclasses.field(default_factory=NonlinearConfig)
    specimen: SpecimenConfig = dataclasses.field(default_factory=SpecimenConfig)
    command_shaper: CommandShaperConfig = dataclasses.field(default_factory=CommandShaperConfig)
    safety: SafetyConfig = dataclasses.field(default_factory=SafetyConfig)
    table: TableConfig = dataclasses.field(default_factory=TableConfig)
    simulated_table: SimulatedTableConfig = dataclasses.field(default_factory=SimulatedTableConfig)
    sensors: SensorsConfig = dataclasses.field(default_factory=SensorsConfig)
    virtual_controller: VirtualControllerConfig = dataclasses.field(default_factory=VirtualControllerConfig)
    servo_hydraulic: ServoHydraulicConfig = dataclasses.field(default_factory=ServoHydraulicConfig)
    identified_model: IdentifiedModelConfig = dataclasses.field(default_factory=IdentifiedModelConfig)
    shear_estimator: ShearEstimatorConfig = dataclasses.field(default_factory=ShearEstimatorConfig)
    force_correction: ForceCorrectionConfig = dataclasses.field(default_factory=ForceCorrectionConfig)
    recorder: RecorderConfig = dataclasses.field(default_factory=RecorderConfig)
    real_time: RealTimeConfig = dataclasses.field(default_factory=RealTimeConfig)
    verdict: VerdictConfig = dataclasses.field(default_factory=VerdictConfig)
    compensation: tuple[Any, ...] = dataclasses.field(
        default_factory=lambda: tuple(SECTIONS[name]() for name in compensation_sections())
    )

    def __post_init__(self) -> None:
        """Check what several sections have to agree on: time steps, capacity, and the stability of the integration."""
        self.sensors.refuse_other_floors(len(self.specimen.masses))
        self.rig.refuse_beyond({"safety": self.safety, "virtual_controller": self.virtual_controller})
        if self.safety.stuck_time < self.run.time_step:
            raise InputError(
                f"safety.stuck_time: {self.safety.stuck_time:g} s is less than one time step; "
                f"run.time_step, {self.run.time_step:g} s, or more is required"
            )
        if self.virtual_controller.answer_after >= self.run.time_step:
            raise InputError(
                f"virtual_controller.answer_after: {self.virtual_controller.answer_after:g} s; "
                f"less than one time step, {self.run.time_step:g} s, is required"
            )
        if self.simulated_table.softening_factor != 1.0 and not self.nonlinear.linear_chain:
            raise InputError(
                "simulated_table.softening_factor: a specimen that softens over a numerical substructure that is not "
                "linear has no reference; 1 or nonlinear.story_model linear is required"
            )
        if "coefficients" not in (self.numerical_substructure.damping, self.nonlinear.damping):
            raise InputError(
                f"nonlinear.damping: {self.nonlinear.damping}, beside numerical_substructure.damping "
                f"{self.numerical_substructure.damping}; one of the two has to be coefficients"
            )
        self._refuse_substeps()
        if self.nonlinear.integration != "exact":
            NonlinearSubstructure(self.numerical_substructure, self.nonlinear, self.integration_step)
        else:
            self.elastic_substructure()

    def _refuse_substeps(self) -> None:
        substeps, name = self.numerical_substructure.substeps, "numerical_substructure.substeps"
        if substeps > 1 and self.compensator.control is not None:
            raise InputError(
                f"{name}: {substeps}, but run.scheme {self.run.scheme} integrates the numerical substructure itself, "
                "once a step; 1 is required"
            )
        if self.integration_step > LONGEST_STEP:
            raise InputError(
                f"{name}: {substeps} steps of {self.run.time_step:g} s; an integration step of at most "
                f"{LONGEST_STEP:g} s is required"
            )

    @property
    def integration_step(self) -> float:
        """Time step of the numerical substructure [s]: Δt, or as many times that as it has sub-steps."""
        return self.run.time_step * self.numerical_substructure.substeps

    def elastic_substructure(self) -> LinearBuilding:
        """Return the numerical substructure for small motion about rest, with all that `nonlinear` adds to it.

        Where stories are linear it is the whole of it.
        """
        return elastic_building(self.numerical_substructure.building(), self.nonlinear)

    @property
    def compensator(self) -> Compensator:
        """The compensator of `run.scheme`."""
        return compensator(self.run.scheme)

    def section(self, name: str) -> Any:
        """Return a section by its name.

        Parameters
        ----------
        name : str
            Of a field of this class, or of the section of a compensator.
        """
        return next((own for own in self.compensation if name == own.SECTION), None) or getattr(self, name)

    def as_mapping(self) -> dict[str, dict[str, Any]]:
        """Return the configuration as nested plain values; arrays are lists."""
        return {name: _plain(self.section(name)) for name in SECTIONS}

    def changed(self, **changes: object) -> Config:
        """Return a copy with some parameters changed.

        Parameters
        ----------
        **changes : object
            Values by ``section__parameter``, for example ``run__scheme="uc"``.

        Returns
        -------
        Config
            The validated copy.

        Raises
        ------
        InputError
            A name is unknown or a value is not allowed.
        """
        given: dict[str, dict[str, Any]] = {}
        for name, value in changes.items():
            section, _, key = name.partition("__")
            given.setdefault(section, {})[key] = value
        mapping = self._released(given)
        for section, values in given.items():
            mapping[section] = {**mapping.get(section, {}), **values}
        return config_from_mapping(mapping, {name: self.section(name) for name in SECTIONS if name not in given})

    def _released(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return all parameters but those that follow from what is given, and have followed before."""
        return released(self.as_mapping(), given, Config().as_mapping() if "rig" in given else {})

    def merged(self, path: str | Path, sections: Collection[str] = ()) -> Config:
        """Return a copy with the parameters of another file, for example an identified model, over its own.

        Parameters
        ----------
        path : str or Path
            File as `load_config` reads it. What it does not name stays, as with a second ``--params-file`` of ROS.
        sections : collection of str, optional
            Only these of its sections count, and it has to have them; by default all it has.

        Returns
        -------
        Config
            The validated copy.

        Raises
        ------
        InputError
            The file is wrong; it is named.
        """
        floors = len(self.specimen.masses)
        read = _read_sections(path)
        if missing := [name for name in sections if name not in read]:
            raise InputError(f"{path}: no section {missing[0]}; it has {', '.join(map(str, read)) or 'none'}")
        counted = {name: values for name, values in read.items() if not sections or name in sections}
        try:
            mapping = self._released(counted)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        for name, values in counted.items():
            known = isinstance(values, Mapping) and name in mapping
            mapping[name] = {**mapping[name], **values} if known else values
        merged = _named(path, mapping)
        if len(merged.specimen.masses) != floors:
            raise InputError(
                f"{path}: specimen.masses has {len(merged.specimen.masses)} entries, the configuration {floors}; "
                "a model of the same specimen is required"
            )
        return merged


_OWN: dict[str, type] = {f.name: cast(type, f.default_factory) for f in fields(Config) if f.name != "compensation"}
#: Section classes by name, in the order of the file.
SECTIONS: dict[str, type] = _OWN | {name: s for name, s in settings_sections().items() if name not in _OWN}


def compensation_sections() -> tuple[str, ...]:
    """Return the names of the sections that are no fields of `Config`: those of compensators, as the registry finds."""
    return tuple(name for name in SECTIONS if name not in _OWN)


def _plain(section: Any) -> dict[str, Any]:
    values = {key: getattr(section, key) for key in specs(type(section))}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}


def config_from_mapping(mapping: Mapping[str, Any], made: Mapping[str, Any] | None = None) -> Config:
    """Build the configuration from nested plain values.

    Parameters
    ----------
    mapping : Mapping
        Section name to parameter name to value.
    made : Mapping, optional
        Section name to a section that is kept, instead of made and checked again, where it has these values.

    Returns
    -------
    Config
        The validated configuration.

    Raises
    ------
    InputError
        A section or parameter is unknown, or a value is not allowed.
    """
    refuse_renamed(mapping, RunConfig.time_step)
    mapping = completed(mapping)
    for name, values in mapping.items():
        if name not in SECTIONS:
            raise InputError(
                f"{name}: unknown section{suggestion(name, SECTIONS)}; allowed here: {', '.join(SECTIONS)}"
            )
        if not isinstance(values, Mapping):
            raise InputError(f"{name}: {_short(values)} is not a section; parameters with values are required")
    kept = {name: section for name, section in (made or {}).items() if _plain(section) == mapping.get(name)}
    sections = {name: kept.get(name) or build_section(SECTIONS[name], values) for name, values in mapping.items()}
    compensation = tuple(sections.pop(name, SECTIONS[name]()) for name in compensation_sections())
    return Config(**sections, compensation=compensation)


def load_config(path: str | Path) -> Config:
    """Read a configuration file, which is also a ROS 2 parameter file.

    Parameters
    ----------
    path : str or Path
        YAML file with the sections below ``/**: ros__parameters:``.

    Returns
    -------
    Config
        The validated configuration.

    Raises
    ------
    InputError
        The file cannot be read, is not such a file, or a value in it is not allowed; the file is named.
    """
    return _named(path, _read_sections(path))


#: Parameters that are paths of files beside a configuration.
BESIDE = (
    ("specimen", "matrices"),
    ("numerical_substructure", "matrices"),
    ("simulated_table", "frequency_response"),
)


def _found_beside(path: str | Path, mapping: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a configuration whose files that lie beside it are told by their whole path."""
    found = dict(mapping)
    for section, key in BESIDE:
        values = found.get(section)
        name = values.get(key) if isinstance(values, Mapping) else None
        if isinstance(values, Mapping) and isinstance(name, str) and name not in ("", NO_FILE):
            beside = Path(path).absolute().parent / name
            found[section] = {**values, key: str(beside if beside.is_file() else Path(name).absolute())}
    return found


def dump_config(config: Config) -> str:
    """Return the configuration as the text of a file that `load_config` and ROS read.

    Parameters
    ----------
    config : Config
        The configuration.

    Returns
    -------
    str
        YAML. Empty arrays are left out, because a ROS parameter file cannot hold them.
    """
    sections = {
        name: {key: value for key, value in section.items() if value != []}
        for name, section in config.as_mapping().items()
    }
    return str(yaml.safe_dump({"/**": {"ros__parameters": sections}}, sort_keys=False, default_flow_style=None))


def _named(path: str | Path, mapping: Mapping[str, Any]) -> Config:
    """Return the configuration of a mapping; what is wrong is told with the path."""
    try:
        return config_from_mapping(mapping)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _read_sections(path: str | Path) -> Mapping[str, Any]:
    document = read_yaml(path)
    try:
        parameters = document["/**"]["ros__parameters"]
    except (TypeError, KeyError):
        raise InputError(
            f"{path}: no parameters found; they are required below '/**:' and 'ros__parameters:'"
        ) from None
    if not isinstance(parameters, Mapping):
        raise InputError(f"{path}: 'ros__parameters:' holds {_short(parameters)}; sections are required")
    return _found_beside(path, parameters)


def _short(value: object) -> str:
    """Return a value for a message, on one line."""
    text = repr(value)
    return text if len(text) <= 200 else text[:200] + "..."
