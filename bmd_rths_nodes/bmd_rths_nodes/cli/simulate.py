"""``bmd-rths simulate``: run a whole test in process."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import click

from bmd_rths_nodes.cli.configuration import RECORD_OPTIONS, ConfigChoice, configured
from bmd_rths_nodes.cli.options import capture_option, json_option, output_folder, progress_bar
from bmd_rths_nodes.cli.preflight import tell_motion
from bmd_rths_nodes.cli.results import result_of, show
from bmd_rths_nodes.run.bag_names import new_bag_directory


@click.command(epilog="Example: bmd-rths simulate config/simplified_bmd.yaml --scheme uc --json")
@configured("scheme", "motion", *RECORD_OPTIONS)
@click.option("--output", type=click.Path(path_type=Path), help="Folder to write a bag of the run into.")
@capture_option
@json_option
def simulate(choice: ConfigChoice, output: Path | None, capture: bool | None, as_json: bool) -> int:
    """Run a test in process, without ROS: the same stages, the same numbers."""
    from bmd_rths_core.analysis.run_analysis import analysed
    from bmd_rths_core.ground_motion.as_run import ground_motion_as_run
    from bmd_rths_core.loop.rths_loop import RthsLoop

    resolved = choice.resolve(table__controller="simulated")
    ran = ground_motion_as_run(resolved.ground_motion, resolved.run.time_step)
    ground_motion = ran.motion
    with output_folder(output) if output is not None else nullcontext():
        with progress_bar() as progress:
            task = progress.add_task(f"{ground_motion.name}, {resolved.run.scheme}", total=ground_motion.steps)
            record = RthsLoop(resolved, ground_motion).run(progress=lambda done: progress.update(task, completed=done))
        result = result_of(analysed(record, capture))
        if output is not None:
            from bmd_rths_msgs_py.record_bag import write_record

            directory = new_bag_directory(output, ground_motion.name, resolved.run.scheme)
            result["bag"] = str(write_record(record, directory))
    tell_motion(resolved, ran)
    show(result, as_json)
    return 0 if record.outcome == "finished" else 1
