"""Make each stage from the configuration; the in-process loop and the nodes make them here, so that they are equal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.phase_lead import CommandShaper
from bmd_rths_core.compensators.protocol import InterfaceControl, Known, SensorNoise, Shaper
from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.loop.control_stage import ControlStage
from bmd_rths_core.loop.numerical_stage import NumericalStage
from bmd_rths_core.loop.substepped_stage import Integration, IntegrationAtOnce, SubsteppedStage
from bmd_rths_core.parameters import section_name
from bmd_rths_core.safety import SafetySupervisor, StabilityIndicator, StabilityIndicatorArray
from bmd_rths_core.stages.force_correction import ForceCorrection
from bmd_rths_core.stages.nonlinear_substructure import NonlinearSubstructure
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructure
from bmd_rths_core.stages.shear_estimator import ShearEstimator
from bmd_rths_core.table.calibration import Calibration
from bmd_rths_core.table.controller import TableController
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.emulated.virtual_controller import VirtualController
from bmd_rths_core.table.emulated.virtual_table import LinearTable, VirtualTable
from bmd_rths_core.table.models.servo_hydraulic import ServoHydraulicTable, refuse_unstable
from bmd_rths_core.table.models.simulated import SimulatedTable

FloatArray = NDArray[np.float64]


def make_calibration(config: Config) -> Calibration:
    """Return the calibration of the sensors.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return Calibration(config.sensors, len(config.specimen.masses))


def make_numerical_substructure(config: Config) -> NumericalSubstructure | NonlinearSubstructure:
    """Return the numerical substructure of a configuration: linear and exact, or integrated explicitly.

    Parameters
    ----------
    config : Config
        The whole configuration; the time step is that of the integration, N Δt with N sub-steps.
    """
    if config.nonlinear.integration != "exact":
        return NonlinearSubstructure(config.numerical_substructure, config.nonlinear, config.integration_step)
    return NumericalSubstructure(config.elastic_substructure(), config.integration_step)


def make_integrated_stage(
    config: Config, ground: FloatArray, integration: Integration | None = None
) -> NumericalSubstructure | NonlinearSubstructure | SubsteppedStage:
    """Return the numerical substructure as the loop steps it, with sub-steps where it has some.

    Parameters
    ----------
    config : Config
        The whole configuration.
    ground : ndarray, shape (N,)
        Ground acceleration of the whole test, which sub-steps take in advance [m/s²].
    integration : Integration, optional
        Computes beside the loop; by default every target is computed at once.
    """
    substeps = config.numerical_substructure.substeps
    if substeps == 1:
        return make_numerical_substructure(config)
    model, mass = make_numerical_substructure(config), config.elastic_substructure().interface_mass
    if integration is None:
        integration = IntegrationAtOnce(model, mass)
    return SubsteppedStage(integration, ground, substeps, model.correction(), mass)


#: Sections that `make_known` reads.
_OF_KNOWN = (
    *("identified_model", "specimen", "numerical_substructure", "nonlinear", "force_correction", "shear_estimator"),
)


def sections_of_compensator(config: Config) -> tuple[str, ...]:
    """Return the sections that the compensator is made from; none for those of the paper, which have their own stages.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    settings = config.compensator.settings
    of_the_paper = config.run.scheme in SCHEME_NAMES
    return () if settings is None or of_the_paper else (section_name(settings), *_OF_KNOWN)


def make_known(config: Config) -> Known:
    """Return what the compensator of a configuration may know: models that were identified, never the simulated truth.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    model = config.identified_model
    specimen = model.specimen(config.specimen.building())
    settings = config.compensator.settings
    return Known(
        time_step=config.run.time_step,
        numerical=config.elastic_substructure(),
        linear=config.nonlinear.integration == "exact",
        specimen=specimen,
        table=model.plant(specimen),
        command_delay=model.command_delay,
        feedback_scale=config.force_correction.feedback_scale,
        load_cell=config.shear_estimator.source == "load_cell",
        noise=SensorNoise(model.acceleration_noise, model.displacement_noise, model.shear_noise),
        settings=None if settings is None else config.section(section_name(settings)),
    )


def make_command_shaper(config: Config) -> Shaper:
    """Return the command shaper of a configuration and its scheme; under an interface control it passes on.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Raises
    ------
    InputError
        The compensator refuses what is known.
    """
    if config.compensator.shaper is None:
        return CommandShaper(config.command_shaper, config.run.time_step, active=False)
    return config.compensator.shaper(make_known(config))


def make_interface_control(config: Config) -> InterfaceControl | None:
    """Return what owns the numerical substructure and the command; None where a shaper compensates.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Raises
    ------
    InputError
        The compensator refuses what is known.
    """
    make = config.compensator.control
    return None if make is None else make(make_known(config))


def make_numerical_stage(config: Config, ground: FloatArray, integration: Integration | None = None) -> NumericalStage:
    """Return what the conductor drives: the numerical substructure, or the interface control in its place.

    Parameters
    ----------
    config : Config
        The whole configuration.
    ground : ndarray, shape (N,)
        Ground acceleration of the whole test, for what has to know it in advance [m/s²].
    integration : Integration, optional
        As for `make_integrated_stage`.

    Raises
    ------
    InputError
        The compensator refuses what is known.
    """
    control = make_interface_control(config)
    return make_integrated_stage(config, ground, integration) if control is None else ControlStage(control, ground)


def make_supervisor(config: Config) -> SafetySupervisor:
    """Return the supervisor in the path of the command.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return SafetySupervisor(config.safety, config.run.time_step)


def make_stability_indicator(config: Config) -> StabilityIndicator:
    """Return the stability indicator of a configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    building = config.elastic_substructure()
    masses, damping = np.asarray(building.masses), building.damping_matrix
    return StabilityIndicator(config.safety, masses, damping, config.run.time_step)


def make_stability_indicator_array(config: Config, runs: int) -> StabilityIndicatorArray:
    """Return the stability indicator of many runs of a configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    runs : int
        Number of runs.
    """
    building = config.elastic_substructure()
    masses, damping = np.asarray(building.masses), building.damping_matrix
    return StabilityIndicatorArray(config.safety, masses, damping, config.run.time_step, runs)


def make_table_controller(config: Config) -> TableController:
    """Return the table controller that needs no hardware; `bmd_rths_nodes.hardware` makes the others.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Raises
    ------
    InputError
        Another one is configured.
    """
    if config.table.controller != "simulated":
        raise InputError(f"table.controller: {config.table.controller!r} is not available in process; simulated is")
    return SimulatedTable(config.simulated_table, config.specimen.building(), config.run.time_step, config.run.seed)


def make_virtual_controller(config: Config, faults: Faults) -> VirtualController:
    """Return the virtual table controller of a configuration, with its table.

    Parameters
    ----------
    config : Config
        The whole configuration.
    faults : Faults
        Its faults, which may change at any time.

    Raises
    ------
    InputError
        The table would not be stable, or the specimen softens or yields, which the virtual controller has no time of
        the test for.
    """
    if config.simulated_table.damaged:
        raise InputError(
            "simulated_table.softening_factor, simulated_table.yield_drifts: not available on a virtual controller; "
            "table.controller simulated is required"
        )
    specimen, seed = config.specimen.building(), config.run.seed
    if config.virtual_controller.model == "servo_hydraulic":
        refuse_unstable(config.servo_hydraulic, config.simulated_table.specimen(specimen))

    def servo(time_step: float) -> VirtualTable:
        return LinearTable(SimulatedTable(config.simulated_table, specimen, time_step, seed), time_step)

    def servo_hydraulic(time_step: float) -> VirtualTable:
        sensors = config.simulated_table.sensors(specimen.stories, seed)
        real = config.simulated_table.specimen(specimen)
        return ServoHydraulicTable(config.servo_hydraulic, sensors, real, time_step)

    make_table = servo if config.virtual_controller.model == "servo" else servo_hydraulic
    return VirtualController(config.virtual_controller, make_table, specimen.stories, config.run.time_step, faults)


def make_shear_estimator(config: Config) -> ShearEstimator:
    """Return the shear estimator of a configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return ShearEstimator(config.shear_estimator, config.specimen.building(), config.run.time_step)


def make_force_correction(config: Config) -> ForceCorrection:
    """Return the force correction of a configuration and its scheme.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return ForceCorrection(config.force_correction, active=config.compensator.force_correction)
