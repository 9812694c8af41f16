"""Put MPIC together from what is known of a test."""

from __future__ import annotations

from bmd_rths_core.compensators.identified_table import held_table
from bmd_rths_core.compensators.mpic.config import MpicConfig
from bmd_rths_core.compensators.mpic.control import MpicControl
from bmd_rths_core.compensators.mpic.estimation import ModelError, observer
from bmd_rths_core.compensators.mpic.packed import PackedStep, packed_step
from bmd_rths_core.compensators.mpic.specimen_observer import specimen_observer
from bmd_rths_core.compensators.mpic.tracking import TrackingWeights, error_system, tracking
from bmd_rths_core.compensators.mpic.trim import TrimLimits, TrimmedControl
from bmd_rths_core.compensators.mpic.virtual_building import virtual_building
from bmd_rths_core.compensators.protocol import Known
from bmd_rths_core.errors import InputError
from bmd_rths_core.table.models.held_plant import held_plant


def design(known: Known) -> PackedStep:
    """Design observer and tracking.

    Parameters
    ----------
    known : Known
        With an identified model of the table; its settings are an `MpicConfig`.

    Returns
    -------
    PackedStep

    Raises
    ------
    InputError
        There is no identified table, the numerical substructure yields, or there is no steady state.
    """
    settings: MpicConfig = known.settings
    if known.table is None:
        raise InputError(
            "identified_model.table: none; scheme mpic requires a model of the table that `bmd-rths identify` wrote"
        )
    if not known.linear:
        raise InputError("nonlinear.integration: scheme mpic requires 'exact', a linear numerical substructure")
    plant = held_plant(known.table, known.command_delay, known.time_step)
    building = virtual_building(known.numerical, known.specimen, known.feedback_scale, known.time_step)
    unmodelled = settings.model_error if known.load_cell else settings.model_error_accelerometers
    error = ModelError(settings.command_error, unmodelled)
    estimation = observer(plant, building, known.specimen, known.noise, known.load_cell, error)
    weights = TrackingWeights(settings.floor_weight, settings.command_weight, settings.centring_frequency)
    driving = tracking(error_system(plant, building, known.time_step), weights, settings.preview)
    own = None
    if settings.observer == "measured_table":
        own = specimen_observer(building, known.specimen, known.noise, known.load_cell, unmodelled, known.time_step)
    return packed_step(plant, building, estimation, driving, known.time_step, own)


def make_control(known: Known) -> MpicControl | TrimmedControl:
    """Return MPIC, ready for step 0, with the options that its settings ask for."""
    settings: MpicConfig = known.settings
    control = MpicControl(design(known), known.specimen.stories, known.load_cell)
    if not settings.trim:
        return control
    limits = TrimLimits(
        settings.trim_memory,
        settings.trim_quiet_acceleration,
        settings.trim_largest_gain,
        settings.trim_largest_delay,
        settings.trim_gain_rate,
        settings.trim_delay_rate,
    )
    return TrimmedControl(control, held_table(known, "mpic"), limits, known.time_step)
