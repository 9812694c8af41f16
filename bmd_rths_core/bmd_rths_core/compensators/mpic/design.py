"""Put MPIC together from what is known of a test."""

from __future__ import annotations

from bmd_rths_core.compensators.mpic.config import MpicConfig
from bmd_rths_core.compensators.mpic.estimation import ModelError, Observer, observer_in_pieces
from bmd_rths_core.compensators.mpic.packed import PackedStep, packed_step
from bmd_rths_core.compensators.mpic.riccati import Pieces, RiccatiSolver, at_once, finished
from bmd_rths_core.compensators.mpic.specimen_observer import SpecimenObserver, specimen_observer_in_pieces
from bmd_rths_core.compensators.mpic.tracking import TrackingWeights, error_system, tracking_in_pieces
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
    return finished(design_in_pieces(known))


def design_in_pieces(known: Known, solve: RiccatiSolver = at_once) -> Pieces[PackedStep]:
    """Return the work of `design`.

    Parameters
    ----------
    known : Known
        As `design` takes it.
    solve : RiccatiSolver
        Solves the Riccati equations.
    """
    settings: MpicConfig = known.settings
    if known.table is None:
        raise InputError(
            "identified_model.table: none; scheme mpic requires a model of the table that `bmd-rths identify` wrote"
        )
    if not known.linear:
        raise InputError("nonlinear.integration: scheme mpic requires 'exact', a linear numerical substructure")
    plant = held_plant(known.table, known.command_delay, known.time_step)
    yield
    building = virtual_building(known.numerical, known.specimen, known.feedback_scale, known.time_step)
    unmodelled = settings.model_error if known.load_cell else settings.model_error_accelerometers
    error = ModelError(settings.command_error, unmodelled)
    sensors = known.noise, known.load_cell
    yield
    estimation = yield from observer_in_pieces(plant, building, known.specimen, *sensors, error, solve)
    weights = TrackingWeights(settings.floor_weight, settings.command_weight, settings.centring_frequency)
    yield
    errors = error_system(plant, building, known.time_step)
    driving = yield from tracking_in_pieces(errors, weights, settings.preview, solve)
    own: SpecimenObserver | Observer | None = None
    if settings.observer == "uncertain_table":
        yield
        loose = ModelError(settings.table_error, unmodelled)
        own = yield from observer_in_pieces(plant, building, known.specimen, *sensors, loose, solve)
    elif settings.observer == "measured_table":
        yield
        own = yield from specimen_observer_in_pieces(
            building, known.specimen, *sensors, unmodelled, known.time_step, solve
        )
    yield
    return packed_step(plant, building, estimation, driving, known.time_step, own)
