"""Faults in virtual time: of the network, the sensors, the hydraulics, the commands, the host, and the loop itself."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.config import Config
from bmd_rths_core.stability.discrete import discrete_margin, with_mass_ratio
from bmd_rths_core.table.emulated.faults import SENSORS
from bmd_rths_core.table.wire import Kind, interlock_names
from tests.conftest import ground_motion_folder
from tests.faults.outcome import RAMP_TIME, Outcome, wrong_motion
from tests.faults.rig import Rig, Trial, VirtualNetwork

Random = np.random.Generator

#: Length of the record, and steps between which a fault begins.
DURATION, FIRST, LAST = 4.0, 60, 700

ALL_SENSORS = (*SENSORS, "floor_1", "floor_2")


def run_trial(kind: str, trial: Trial) -> Outcome:
    """Run a test with a fault and look at what has to hold.

    Parameters
    ----------
    kind : str
        Kind of the fault.
    trial : Trial
        The test.
    """
    rig = Rig(trial)
    ended, reason = rig.run()
    network, controller = rig.network, rig.network.controller
    give_up = rig.ended_at + round(RAMP_TIME * 1e9)
    while not controller.at_rest and network.time < give_up:
        network.pass_time(network.time + 10_000_000)
    rest_time = 1e-9 * (network.time - rig.ended_at)
    reason = f"{reason}; {interlock_names(controller.interlock)}" if controller.interlock else reason
    wrong = wrong_motion(trial.config, controller.motion, controller.peaks)
    if not controller.at_rest:
        wrong.append("the controller still moves the table")
    if not trial.can_rest:
        wrong = [text for text in wrong if "rest" not in text and "still moves" not in text]
    if not reason or (trial.dies and not controller.interlock):
        wrong.append("no reason is told")
    if trial.must_end and ended == "finished":
        wrong.append("the test went on as if nothing had happened")
    return Outcome(kind, trial.fault, ended, reason, tuple(wrong), controller.peaks, rest_time)


def _config(random: Random, model: str = "", **changes: object) -> Config:
    """Return a test that is stable without the fault."""
    drawn = {
        "run__scheme": str(random.choice(SCHEME_NAMES)),
        "run__seed": int(random.integers(2**31)),
        "virtual_controller__model": model or str(random.choice(("servo", "servo_hydraulic"))),
        "ground_motion__duration": DURATION,
        "ground_motion__peak_acceleration": float(random.uniform(0.3, 1.5)),
    }
    return Config().changed(**drawn | changes)


def _step(random: Random) -> int:
    return int(random.integers(FIRST, LAST))


def _network(name: str, low: float, high: float, unit: str) -> Callable[[Random], Trial]:
    """Return a maker of trials with a fault of the network of random size."""

    def draw(random: Random) -> Trial:
        size, begins = round(random.uniform(low, high), 1), _step(random)
        return Trial(f"{name} {size:g} {unit}", _config(random), begins, (f"{name}={size}@{begins}",))

    return draw


def _sensor(name: str) -> Callable[[Random], Trial]:
    def draw(random: Random) -> Trial:
        sensor, begins = str(random.choice(ALL_SENSORS)), _step(random)
        return Trial(f"{name} {sensor}", _config(random), begins, (f"{name}={sensor}@{begins}",), must_end=True)

    return draw


def _hydraulics(name: str, high: float) -> Callable[[Random], Trial]:
    def draw(random: Random) -> Trial:
        left, begins = round(random.uniform(0.0, high), 1), _step(random)
        config = _config(random, "servo_hydraulic")
        return Trial(f"{name} {left:g} % left", config, begins, (f"{name}={left}@{begins}",))

    return draw


def _dead(random: Random) -> Trial:
    begins = _step(random)
    return Trial("controller does not answer", _config(random), begins, (f"dead@{begins}",), must_end=True)


def _frozen(random: Random) -> Trial:
    """Nobody can move a table whose controller does nothing any more; the model stands still with it."""
    begins = _step(random)
    faults = (f"frozen@{begins}",)
    return Trial("controller does nothing", _config(random), begins, faults, must_end=True, can_rest=False)


def _command(random: Random) -> Trial:
    begins = _step(random)
    wrong = float(random.choice((math.nan, math.inf, -math.inf, 1e300, 1e4, -25.0, 20.0)))
    return Trial(
        f"command {wrong:g}",
        _config(random),
        begins,
        command=lambda step, command: wrong if step == begins else command,
        must_end=True,
    )


def _drift(random: Random) -> Trial:
    """Make the command wrong by a constant, which leads to the stops slowly."""
    begins, offset = _step(random), float(random.uniform(0.5, 3.0))
    return Trial(
        f"command off by {offset:.2g} m/s2",
        _config(random),
        begins,
        command=lambda step, command: command + offset * (step >= begins),
        must_end=True,
    )


def _shear(random: Random) -> Trial:
    begins = _step(random)
    wrong = float(random.choice((math.nan, math.inf, 1e6, -1e6, 1e9, 1e200)))
    return Trial(
        f"corrected shear {wrong:g} N",
        _config(random),
        begins,
        shear=lambda step, shear: wrong if step == begins else shear,
        must_end=True,
    )


def _host_dies(random: Random) -> Trial:
    return Trial("host sends nothing any more", _config(random), _step(random), dies=True, must_end=True)


def _stall(random: Random) -> Trial:
    begins, stall = _step(random), float(random.uniform(0.01, 0.3))

    def beside(network: VirtualNetwork, step: int) -> None:
        if step == begins:
            network.stall(stall)

    return Trial(f"host stalls for {1e3 * stall:.0f} ms", _config(random), begins, beside=beside)


def _intruder(random: Random) -> Trial:
    """Let a second host with a session of its own talk to the controller that the first one is using."""
    begins, kind = _step(random), Kind(int(random.integers(len(Kind))))

    def beside(network: VirtualNetwork, step: int) -> None:
        if step >= begins:
            network.intrude(kind, step, 5.0)

    return Trial(f"packets of another host: {kind.name.lower()}", _config(random), begins, beside=beside)


def _unstable(random: Random) -> Trial:
    """Mass ratio above the margin, on Christchurch where the record is there.

    The margin is that of the servo table whose sensors are read at the end of a step, so the answers are late here.
    """
    scheme, share = str(random.choice(SCHEME_NAMES)), float(random.uniform(1.3, 2.0))
    christchurch = ground_motion_folder() / "Christchurch" / "RSN8123_CCHURCH_REHSN02E.AT2"
    config = _config(
        random,
        "servo",
        run__scheme=scheme,
        ground_motion__record=str(christchurch) if christchurch.exists() else Config().ground_motion.record,
        ground_motion__duration=20.0,
        virtual_controller__answer_after=0.0045,
        table__answer_timeout=0.0049,
    )
    config = with_mass_ratio(config, share * discrete_margin(config).allowable_mass_ratio)
    return Trial(f"mass ratio {share:.2f} of the allowable, {scheme}", config, 0, must_end=True)


#: Makers of trials by kind.
KINDS: dict[str, Callable[[Random], Trial]] = {
    "loss": _network("loss", 1.0, 50.0, "%"),
    "delay": _network("delay", 0.0, 20.0, "ms"),
    "jitter": _network("jitter", 0.0, 10.0, "ms"),
    "duplicates": _network("duplicates", 1.0, 50.0, "%"),
    "reordering": _network("reordering", 1.0, 50.0, "%"),
    "bit_flips": _network("bit_flips", 1.0, 50.0, "%"),
    "nan_sensor": _sensor("nan"),
    "stuck_sensor": _sensor("stuck"),
    "dead_controller": _dead,
    "frozen_controller": _frozen,
    "valve": _hydraulics("valve", 50.0),
    "pressure": _hydraulics("pressure", 90.0),
    "wrong_command": _command,
    "drifting_command": _drift,
    "wrong_shear": _shear,
    "dead_host": _host_dies,
    "stalled_host": _stall,
    "second_host": _intruder,
    "unstable": _unstable,
}


def outcome_of(kind: str, seed: int) -> Outcome:
    """Return what the fault of a kind and a seed comes to.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    seed : int
        Seed of everything random.
    """
    return run_trial(kind, KINDS[kind](np.random.default_rng([seed, *kind.encode()])))
