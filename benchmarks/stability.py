"""Time of a margin curve: allowable mass ratio over 200 frequencies, against python-control in the same run.

The same loop (Eq. 9, phase-lead compensation, one step of delay, every mode of the 8-story specimen) and the same
exact delays on both sides. Two ways of python-control are measured on a frequency grid of its own: bisection of the
mass ratio with `nyquist_response`, and one call of `stability_margins` a point, which knows the gain margin without
bisection but not the encirclements. Run it with

    python benchmarks/stability.py
    python benchmarks/stability.py --quick    # fewer points for python-control, scaled up
    python benchmarks/stability.py --json

The ratios travel to other machines, the milliseconds do not.
"""

from __future__ import annotations

import json
import statistics
import time
import warnings
from collections.abc import Callable

import click
import control
import numpy as np

from bmd_rths_core.compensators.phase_lead import CommandShaperConfig, transfer_function
from bmd_rths_core.stability.continuous import LARGEST_MASS_RATIO, margin_curve
from bmd_rths_core.stability.models import (
    EQUATION_9,
    experimental_building,
    first_effective_mass,
    phase_lead_compensator,
    table_sections,
)
from bmd_rths_core.structure.shear_building import ShearBuilding

DT = 0.005
ZETA = 0.02
FREQUENCIES = np.linspace(5.0, 150.0, 200)
SPECIMEN = ShearBuilding((760.0, *[800.0] * 4), (2495320.0, *[4941700.0] * 4), (3330.0, *[78.0] * 4))
SHAPER = CommandShaperConfig(2.0, 2.0, 0.025)
#: Frequencies at which python-control sees the loop [rad/s].
GRID = np.linspace(0.1, 1500.0, 6000)
#: Bisection ends at this width of the mass ratio.
TOLERANCE = 1e-6
REPEATS = 5


def ours(frequencies: np.ndarray) -> np.ndarray:
    compensator = phase_lead_compensator(SHAPER, DT)
    table, specimen = table_sections(EQUATION_9), experimental_building(SPECIMEN)
    return margin_curve(frequencies, ZETA, specimen, table, compensator, DT).allowable_mass_ratios


def rest_of_the_loop() -> np.ndarray:
    """Everything but the numerical substructure on the grid, by python-control."""
    a, b, c = SPECIMEN.relative_motion()
    shear = control.ss(a, b, -np.asarray(SPECIMEN.masses)[None, :] @ c, 0.0)
    table = control.tf([1.0], [1.0])
    for row in np.reshape(EQUATION_9, (-1, 6)):
        table = table * control.tf(np.trim_zeros(row[:3], "f"), np.trim_zeros(row[3:], "f"))
    numerator, denominator = transfer_function(SHAPER, DT)
    compensator = np.polyval(numerator, np.exp(1j * GRID * DT)) / np.polyval(denominator, np.exp(1j * GRID * DT))
    response = shear(1j * GRID) / first_effective_mass(SPECIMEN) * table(1j * GRID)
    return -response * compensator * np.exp(-1j * GRID * DT)


def loop(rest: np.ndarray, frequency: float) -> control.FrequencyResponseData:
    oscillator = control.tf([1.0, 0.0, 0.0], [1.0, 2.0 * ZETA * frequency, frequency**2])
    return control.frd(oscillator(1j * GRID) * rest, GRID, smooth=False)


def by_nyquist(frequencies: np.ndarray) -> np.ndarray:
    rest, ratios = rest_of_the_loop(), []
    for frequency in frequencies:
        one = loop(rest, frequency)
        lower, upper = 0.0, LARGEST_MASS_RATIO
        while upper - lower > TOLERANCE:
            middle = 0.5 * (lower + upper)
            count = control.nyquist_response(one * (middle / (1.0 - middle))).count
            lower, upper = (middle, upper) if count == 0 else (lower, middle)
        ratios.append(lower)
    return np.array(ratios)


def by_gain_margin(frequencies: np.ndarray) -> np.ndarray:
    rest, ratios = rest_of_the_loop(), []
    for frequency in frequencies:
        gains = np.atleast_1d(control.stability_margins(loop(rest, frequency), returnall=True)[0])
        ratio = gains.min() if len(gains) else np.inf
        ratios.append(min(ratio / (1.0 + ratio), LARGEST_MASS_RATIO))
    return np.array(ratios)


def timed(curve: Callable[[np.ndarray], np.ndarray], frequencies: np.ndarray) -> tuple[float, np.ndarray]:
    begin = time.perf_counter()
    ratios = curve(frequencies)
    return time.perf_counter() - begin, ratios


@click.command()
@click.option("--quick", is_flag=True, help="Give python-control every tenth point and scale its time.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def main(quick: bool, as_json: bool) -> None:
    """Compare the time and the answers."""
    warnings.simplefilter("ignore")
    stride = 10 if quick else 1
    ours(FREQUENCIES[:2])  # imports and first calls are nobody's time
    by_gain_margin(FREQUENCIES[:1])
    # Before, between and after the others, so that a busy minute does not fall on one of them alone.
    runs = [timed(ours, FREQUENCIES) for _ in range(REPEATS)]
    others = {}
    for name, curve in (("nyquist bisection", by_nyquist), ("stability_margins", by_gain_margin)):
        others[name] = timed(curve, FREQUENCIES[::stride])
        runs += [timed(ours, FREQUENCIES) for _ in range(REPEATS)]
    seconds, reference = statistics.median(run[0] for run in runs), runs[0][1]
    result: dict[str, dict[str, float]] = {"bmd_rths": {"seconds": seconds}}
    for name, (theirs, ratios) in others.items():
        difference = np.abs(ratios - reference[::stride])
        result[name] = {
            "seconds": theirs * stride,
            "ratio": theirs * stride / seconds,
            "median difference": float(np.median(difference)),
            "largest difference": float(np.max(difference)),
        }
    if as_json:
        print(json.dumps(result))
        return
    print(f"margin curve of {len(FREQUENCIES)} points: {seconds * 1e3:.1f} ms, median of {len(runs)}")
    for name, values in list(result.items())[1:]:
        print(
            f"python-control, {name}: {values['seconds']:.2f} s, x {values['ratio']:.0f};"
            f" difference of the mass ratio: median {values['median difference']:.1e},"
            f" largest {values['largest difference']:.1e}"
        )


if __name__ == "__main__":
    main()
