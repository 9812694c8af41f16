"""Make each stage from the configuration; the in-process loop and the nodes make them here, so that they are equal."""

from __future__ import annotations

from bmd_rths_core.compensators.phase_lead import CommandShaper
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.safety import SafetySupervisor, StabilityIndicator, StabilityIndicatorArray
from bmd_rths_core.stages.force_correction import ForceCorrection
from bmd_rths_core.stages.nonlinear_substructure import NonlinearSubstructure
from bmd_rths_core.stages.numerical_substructure import NumericalSubstructure
from bmd_rths_core.stages.shear_estimator import ShearEstimator
from bmd_rths_core.structure.nonlinear_building import nonlinear_building
from bmd_rths_core.table.controller import TableController
from bmd_rths_core.table.emulated.faults import Faults
from bmd_rths_core.table.emulated.virtual_controller import VirtualController
from bmd_rths_core.table.emulated.virtual_table import LinearTable, VirtualTable
from bmd_rths_core.table.models.servo_hydraulic import ServoHydraulicTable
from bmd_rths_core.table.models.simulated import SimulatedTable


def make_numerical_substructure(config: Config) -> NumericalSubstructure | NonlinearSubstructure:
    """Return the numerical substructure of a configuration: linear and exact, or integrated explicitly.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    if config.nonlinear.integration != "exact":
        return NonlinearSubstructure(config.numerical_substructure, config.nonlinear, config.run.time_step)
    return NumericalSubstructure(config.numerical_substructure, config.run.time_step)


def make_command_shaper(config: Config) -> CommandShaper:
    """Return the command shaper of a configuration and its scheme.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return CommandShaper(config.command_shaper, config.run.time_step, active=config.scheme.phase_lead)


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
    building = nonlinear_building(config.numerical_substructure.building(), config.nonlinear)
    return StabilityIndicator(config.safety, building.masses, building.damping_matrix, config.run.time_step)


def make_stability_indicator_array(config: Config, runs: int) -> StabilityIndicatorArray:
    """Return the stability indicator of many runs of a configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    runs : int
        Number of runs.
    """
    building = nonlinear_building(config.numerical_substructure.building(), config.nonlinear)
    masses, damping = building.masses, building.damping_matrix
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
    """
    specimen, seed = config.specimen.building(), config.run.seed

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
    return ForceCorrection(config.force_correction, active=config.scheme.force_correction)
