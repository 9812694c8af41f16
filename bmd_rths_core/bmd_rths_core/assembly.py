"""Make each stage from the configuration; the in-process loop and the nodes make them here, so that they are equal."""

from __future__ import annotations

from bmd_rths_core.command_shaper import CommandShaper
from bmd_rths_core.config import Config
from bmd_rths_core.force_correction import ForceCorrection
from bmd_rths_core.nonlinear_substructure import NonlinearSubstructure
from bmd_rths_core.numerical_substructure import NumericalSubstructure
from bmd_rths_core.safety import CommandLimit
from bmd_rths_core.shear_estimator import ShearEstimator
from bmd_rths_core.table.controller import TableController
from bmd_rths_core.table.simulated import SimulatedTable


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
    return CommandShaper(config.command_shaper, active=config.scheme.phase_lead)


def make_command_limit(config: Config) -> CommandLimit:
    """Return the limits in the path of the command.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return CommandLimit(config.safety)


def make_table_controller(config: Config) -> TableController:
    """Return the table controller of a configuration.

    Parameters
    ----------
    config : Config
        The whole configuration.
    """
    return SimulatedTable(config.simulated_table, config.specimen.building(), config.run.time_step, config.run.seed)


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
