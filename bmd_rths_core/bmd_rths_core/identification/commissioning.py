"""What a small pulse and a table at rest tell of the sensors, and each limit tried on a simulated table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bmd_rths_core.config import Config
from bmd_rths_core.identification.excited_table import DrivingStopped, Responses, drive
from bmd_rths_core.identification.frequency_response import FloatArray
from bmd_rths_core.identification.output import model_text
from bmd_rths_core.loop.build import make_supervisor
from bmd_rths_core.table.controller import TableController
from bmd_rths_core.table.models.simulated import SimulatedTable

#: A pulse lasts this long [s], slow against the first mode of a specimen; so many of them are driven.
PULSE_TIME, PULSES = 2.0, 3
#: Rest before and after the pulses, and for the noise floor [s].
REST = 4.0
#: Share of the stroke limit that a pulse uses.
PULSE_SHARE = 0.1
#: Gains of accelerometer and displacement that are further apart are told as a wrong scale.
SCALE_TOLERANCE = 0.15

LIMITS = ("displacement", "velocity", "acceleration", "force")


@dataclass(frozen=True)
class Finding:
    """One step of the commissioning.

    Parameters
    ----------
    step : str
        What was tried.
    passed : bool
        It is as it should be.
    told : str
        What was found, on one line.
    """

    step: str
    passed: bool
    told: str


def pulse_commands(config: Config) -> FloatArray:
    """Return rest, slow pulses of the table to one side, and rest again, as acceleration commands [m/s²].

    Parameters
    ----------
    config : Config
        The whole configuration; a pulse goes to `PULSE_SHARE` of its displacement limit, and is slower for a table
        that would pass a fifth of its acceleration limit.
    """
    step, limits = config.run.time_step, config.safety
    reach = PULSE_SHARE * limits.displacement_limit
    duration = max(PULSE_TIME, 2.0 * np.pi * np.sqrt(2.0 * reach / (0.2 * limits.acceleration_limit)))
    phase = 2.0 * np.pi * np.arange(round(duration / step)) / round(duration / step)
    # x = reach ((1 − cos φ) / 2)², which begins and ends at rest with its acceleration
    pulse = reach * (2.0 * np.pi / duration) ** 2 * 0.5 * (np.cos(phase) - np.cos(2.0 * phase))
    rest = np.zeros(round(REST / step))
    return np.concatenate((rest, np.tile(pulse, PULSES), rest))


def at_rest(responses: Responses, config: Config) -> list[Finding]:
    """Return mean and noise of every sensor while the table was asked for nothing.

    Parameters
    ----------
    responses : Responses
        Of `pulse_commands`.
    config : Config
        The whole configuration.
    """
    begin = slice(0, round(0.9 * REST / responses.time_step))
    assumed = config.identified_model
    known = {"m/s2": assumed.acceleration_noise, "m": assumed.displacement_noise, "N": assumed.shear_noise}
    findings = []
    for name, values, unit in _channels(responses):
        if not np.isfinite(values).all():
            findings.append(Finding(f"noise floor and zero, {name}", True, "no such sensor"))
            continue
        mean, noise = float(np.mean(values[begin])), float(np.std(values[begin]))
        allowed = 3.0 * known[unit]
        told = f"zero at {mean:.4g} {unit}, noise {noise:.4g} {unit} (known as {known[unit]:.4g} {unit})"
        findings.append(Finding(f"noise floor and zero, {name}", abs(mean) <= allowed and noise <= allowed, told))
    return findings


def zero_offsets(responses: Responses, config: Config) -> dict[str, float | list[float]]:
    """Return the offsets with which every sensor reads zero at rest, by their names in `sensors`.

    Parameters
    ----------
    responses : Responses
        Of `pulse_commands`, with the calibration of `config`; a sensor that is not there keeps its offset.
    config : Config
        The whole configuration.
    """
    begin, sensors = slice(0, round(0.9 * REST / responses.time_step)), config.sensors
    floors = responses.floors.shape[1]
    before = zip(sensors.floor_offsets or (0.0,) * floors, sensors.floor_scales or (1.0,) * floors, strict=True)
    found: dict[str, float | list[float]] = {
        "floor_offsets": [
            offset + float(np.mean(values[begin])) / scale
            for (offset, scale), values in zip(before, responses.floors.T, strict=True)
        ]
    }
    own = {
        "table_displacement": responses.displacement,
        "table_acceleration": responses.table,
        "base_shear": responses.shear,
    }
    for name, values in own.items():
        if values is not None and np.isfinite(values).all():
            zero = float(np.mean(values[begin])) / getattr(sensors, f"{name}_scale")
            found[f"{name}_offset"] = getattr(sensors, f"{name}_offset") + zero
    return found


def zero_file(responses: Responses, config: Config) -> str:
    """Return `zero_offsets` as the text of a parameter file.

    Parameters
    ----------
    responses : Responses
        Of `pulse_commands`.
    config : Config
        The whole configuration.
    """
    return model_text({"sensors": zero_offsets(responses, config)}, ("readings at rest, by bmd-rths commission",))


def emergency_stop(table: TableController) -> Finding:
    """Arm a table at rest, ask its controller for the emergency stop, and look whether it confirms it.

    Parameters
    ----------
    table : TableController
        Released afterwards; its controller may stay in its interlock until a person resets it.
    """
    step = "emergency stop of the controller"
    try:
        table.connect()
        table.emergency_stop()
        if not hasattr(table, "stop_confirmed"):
            return Finding(step, True, "asked for; this controller cannot confirm it")
        if not table.stop_confirmed:
            return Finding(step, False, "was not confirmed by the controller")
        return Finding(step, True, "confirmed; an interlock has to be reset at the controller before the next test")
    except (OSError, RuntimeError) as error:
        return Finding(step, False, str(error))
    finally:
        table.close()


def polarity_and_scale(responses: Responses, config: Config) -> list[Finding]:
    """Return whether every sensor moves the way the pulses go, and accelerometer and displacement agree.

    Parameters
    ----------
    responses : Responses
        Of `pulse_commands`.
    config : Config
        The whole configuration.
    """
    rest = round(0.9 * REST / responses.time_step)
    command, zero = responses.command, slice(0, rest)
    motion = np.cumsum(np.cumsum(command)) * responses.time_step**2
    table = responses.table - responses.table[zero].mean()
    masses = np.asarray(config.specimen.masses)
    floors = responses.floors - responses.floors[zero].mean(axis=0)
    gain = _gain(table, command)
    findings = [_sign("accelerometer of the table", gain, "sensors.table_acceleration_scale")]
    own = None
    if responses.displacement is not None and np.isfinite(responses.displacement).all():
        own = _gain(responses.displacement - responses.displacement[zero].mean(), motion)
        findings.append(_sign("displacement of the table", own, "sensors.table_displacement_scale"))
    for floor, values in enumerate(floors.T, 1):
        findings.append(_sign(f"accelerometer of floor {floor}", _gain(values, command), "sensors.floor_scales"))
    if responses.shear is not None and np.isfinite(responses.shear).all():
        shear = _gain(responses.shear - responses.shear[zero].mean(), -command * masses.sum())
        findings.append(_sign("load cells", shear, "sensors.base_shear_scale"))
    if own is not None:
        ratio = gain / own if own else float("inf")
        told = f"the accelerometer of the table says {ratio:.3f} of what its displacement says"
        findings.append(Finding("scale against the displacement", abs(ratio - 1.0) <= SCALE_TOLERANCE, told))
    return findings


def try_limit(config: Config, limit: str) -> Finding:
    """Return what the supervisor does when one limit is passed, on the simulated table.

    Parameters
    ----------
    config : Config
        The whole configuration.
    limit : str
        One of `LIMITS`.
    """
    others = {f"safety__{name}_action": "ignore" for name in (*LIMITS, "increment", "tracking") if name != limit}
    one = config.changed(**others)
    table = SimulatedTable(one.simulated_table, one.specimen.building(), one.run.time_step, one.run.seed)
    step, safety = one.run.time_step, one.safety
    mass = one.simulated_table.platen_mass + one.specimen.building().total_mass
    asked = {
        "displacement": 0.1 * safety.acceleration_limit,
        "velocity": 0.1 * safety.acceleration_limit,
        "acceleration": 1.1 * safety.acceleration_limit,
        "force": 1.5 * safety.force_limit / mass,
    }[limit]
    lasting = 2.0 * max(1.0, safety.velocity_limit / asked, (2.0 * safety.displacement_limit / asked) ** 0.5)
    time = np.arange(round(lasting / step)) * step
    commands = asked * np.minimum(1.0, time / 0.2)
    try:
        drive(table, make_supervisor(one), commands, step)
    except DrivingStopped as stopped:
        return Finding(
            f"limit of {limit}, on the simulated table", f"safety.{limit}_limit" in str(stopped), str(stopped)
        )
    told = f"was not passed by {asked:.3g} m/s2 for {lasting:.3g} s"
    return Finding(f"limit of {limit}, on the simulated table", False, told)


def _channels(responses: Responses) -> list[tuple[str, FloatArray, str]]:
    nothing = np.full(len(responses.table), np.nan)
    displacement = nothing if responses.displacement is None else responses.displacement
    shear = nothing if responses.shear is None else responses.shear
    floors = [(f"floor {i}", values, "m/s2") for i, values in enumerate(responses.floors.T, 1)]
    own = [("acceleration of the table", responses.table, "m/s2"), ("displacement of the table", displacement, "m")]
    return [*own, *floors, ("load cells", shear, "N")]


def _gain(values: FloatArray, expected: FloatArray) -> float:
    """Return how much of an expected course is in the values, whatever their delay of up to a tenth of a pulse."""
    return float(np.dot(values, expected) / np.dot(expected, expected))


def _sign(sensor: str, gain: float, parameter: str) -> Finding:
    if gain > 0.0:
        return Finding(f"polarity, {sensor}", True, f"moves with the table, {gain:.3f} of the command")
    told = f"moves against the table, {gain:.3f} of the command; {parameter} needs the other sign"
    return Finding(f"polarity, {sensor}", False, told)
