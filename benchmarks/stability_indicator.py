"""What ends stable and unstable runs of the virtual laboratory: 13 earthquakes, 4 schemes, mass ratios by margin.

For every scheme the mass ratio is set to some multiples of the discrete margin, and every record is followed by rest,
in which only what grows by itself is left. Real records are needed:

    BMD_RTHS_GROUND_MOTIONS=/path/to/records python benchmarks/stability_indicator.py

docs/decisions/0009-safety-supervisor.md has the results.
"""

from __future__ import annotations

import re
import tempfile
from collections import Counter
from pathlib import Path

import click
import numpy as np
from campaign import CONFIG, HIGH_PASS_HZ, write_list

from bmd_rths_core.campaign.engine import SelectedMotion, run_motions
from bmd_rths_core.campaign.motions import CampaignMotion, read_motions
from bmd_rths_core.campaign.study import with_scheme
from bmd_rths_core.compensators.schemes import SCHEME_NAMES
from bmd_rths_core.config import Config, load_config
from bmd_rths_core.ground_motion.config import prepare_ground_motion
from bmd_rths_core.stability.discrete import discrete_margin, with_mass_ratio

#: Mass ratios over the margin; 0 stands for the campaign itself.
FACTORS = (0.0, 0.9, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0)


def outcomes(config: Config, motions: list[CampaignMotion], rest: float) -> tuple[Counter[str], float]:
    """Return by how many runs each limit was passed, and the largest command of all [m/s²]."""
    selections = [motion.select(config.changed(ground_motion__free_vibration=rest).ground_motion) for motion in motions]
    selected = [
        SelectedMotion(selection, prepare_ground_motion(motion.motion, selection, config.run.time_step))
        for motion, selection in zip(motions, selections, strict=True)
    ]
    records = [run.record for run in run_motions(config, selected)]
    limits = [re.search(r"safety\.(\w+)_(?:limit|action)", record.reason) for record in records]
    ended = Counter("none" if limit is None else limit[1] for limit in limits)
    return ended, max(float(np.nanmax(np.abs(record.applied_command))) for record in records)


@click.command()
@click.option("--rest", default=60.0, show_default=True, help="Rest after each record [s].")
def main(rest: float) -> None:
    """Run them and print which limits ended how many."""
    base = load_config(CONFIG).changed(ground_motion__high_pass_frequency=HIGH_PASS_HZ)
    with tempfile.TemporaryDirectory() as folder:
        motions = read_motions(write_list(Path(folder))).motions
    print(f"{'scheme':8}{'of margin':>10}  runs by the limit that ended them; largest command applied")
    for scheme in SCHEME_NAMES:
        config = with_scheme(base, scheme)
        margin = discrete_margin(config).allowable_mass_ratio
        for factor in FACTORS:
            of_factor = config if factor == 0.0 else with_mass_ratio(config, factor * margin)
            ended, largest = outcomes(of_factor, motions, rest)
            told = ", ".join(f"{name} {count}" for name, count in ended.most_common())
            print(f"{scheme:8}{factor or 'as it is':>10}  {told}; {largest:.1f} m/s²")


if __name__ == "__main__":
    main()
