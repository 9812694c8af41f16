"""Run the pieces of a campaign on the ROS graph: one test after the other, each result from its bag alone."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from bmd_rths_core.analysis.numerical_motion import peak_drifts
from bmd_rths_core.analysis.run_analysis import RunAnalysis, analysed
from bmd_rths_core.campaign.engine import CampaignRun
from bmd_rths_core.campaign.study import Piece, PlannedRun, key_of_run, result_of_run
from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.config import prepare_ground_motion
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.record import RunRecord
from bmd_rths_msgs_py.bag_reader import bag_is_whole, read_bag
from bmd_rths_nodes.campaign.pool import CampaignStopped, Results, bag_of
from bmd_rths_nodes.run.execute import COMPOSED_PROCESSES, run_on_ros
from bmd_rths_nodes.run.follower import RunFailed
from bmd_rths_nodes.run.monitor import RunMonitor

#: The engine of these runs, in keys and results.
ENGINE = "ros"

#: Where a bag is until it is complete, in the folder of the bags.
_UNFINISHED = ".unfinished"

#: What is so for every run on the ROS graph. None is predicted: nothing can happen to the simulated table, and a run
#: that a limit ends is a result.
DECIDED = {
    "table.controller": "simulated",
    "run.lockstep": True,
    "run.record": True,
    "run.preflight": "skip",
}

#: Time in which nodes that are already there are discovered, once a campaign [s]. Fast DDS repeats its announcements
#: every 3 s; on a busy machine the first ones get lost.
_DISCOVERY = 4.0

#: Longest wait until the nodes of the last run, or those of a campaign that was killed, are gone [s]. Fast DDS forgets
#: a process that was killed, because it did not end in time on a busy machine, after 20 s.
_FORGETTING = 30.0

#: How a test ends that has a result.
_COMPLETE = ("finished", "limit")


class _Test(NamedTuple):
    """A run, ready to be started."""

    piece: Piece
    plan: PlannedRun
    config: Config
    motion: GroundMotion

    @property
    def name(self) -> str:
        return f"{self.motion.name}, {self.plan.scheme}"

    def is_that_of(self, record: RunRecord) -> bool:
        """Tell whether a recording is one of this run, by what it says itself."""
        config = config_from_mapping(record.configuration)
        config = config.changed(recorder__directory=self.piece.config.recorder.directory)
        return key_of_run(config, record.motion["sha256"], ENGINE, self.piece.capture) == self.plan.key

    def analysis_of(self, bag: Path) -> RunAnalysis:
        """Return what a bag comes to.

        Raises
        ------
        InputError
            It is not a complete recording of this run.
        """
        if not bag_is_whole(bag):
            raise InputError(f"{bag}: cut")
        record = read_bag(bag)
        if record.outcome not in _COMPLETE:
            raise InputError(f"{record.outcome}: {record.reason}")
        if not self.is_that_of(record):
            raise InputError(f"{bag}: the recording of another run")
        analysis = analysed(record, self.piece.capture)
        missing = analysis.metrics.missing_values
        if record.outcome == "finished" and (missing or record.steps != self.motion.steps):
            raise InputError(f"{record.steps} of {self.motion.steps} steps recorded, {missing} values missing")
        return analysis


@dataclass(frozen=True)
class RosRunner:
    """Runs pieces on the ROS graph: in lockstep, the loop in one process and the recorder in another.

    Parameters
    ----------
    bags : Path
        Folder of the bags, absolute.
    interrupts : sequence of int
        Signals received so far; a handler appends to it. The first one stops the campaign.
    log : callable
        Prints one line for the operator.
    on_progress : callable
        Called with a text of the state of the running test, several times a second.
    """

    bags: Path
    interrupts: Sequence[int]
    log: Callable[[str], None]
    on_progress: Callable[[str], None]

    def results(self, pieces: Iterator[Piece]) -> Iterator[Results]:
        """Run one test after the other.

        Parameters
        ----------
        pieces : iterator of Piece
            The pieces.

        Yields
        ------
        list of dict
            The result of one run.

        Raises
        ------
        CampaignStopped
            A run failed, or the operator stopped it.
        InputError
            A run cannot begin, because its ground motion is not possible.
        """
        with RunMonitor(discovery_time=_DISCOVERY) as monitor:  # one for all runs, because discovery takes its time
            for piece in pieces:
                for plan in piece.runs:
                    if self.interrupts:
                        raise CampaignStopped("stopped")
                    yield [self._result(piece, plan, monitor)]

    def _result(self, piece: Piece, plan: PlannedRun, monitor: RunMonitor) -> dict[str, Any]:
        motion = piece.motions[plan.motion]
        config = piece.config.changed(
            run__scheme=plan.scheme,
            ground_motion__record=motion.record,
            ground_motion__component=motion.component,
            ground_motion__unit=motion.unit,
            recorder__directory=str(self.bags / _UNFINISHED),
        )
        prepared = prepare_ground_motion(motion.motion, config.ground_motion, config.run.time_step)
        test = _Test(piece, plan, config, prepared)
        bag = bag_of({"motion": prepared.name, "scheme": plan.scheme, "key": plan.key}, self.bags)
        try:
            analysis = test.analysis_of(bag)  # of a campaign that was killed before it wrote the result
        except InputError:
            shutil.rmtree(bag, ignore_errors=True)
            analysis = self._recorded(test, bag, monitor)
        record = analysis.record
        run = CampaignRun(record, ENGINE, peak_drifts=peak_drifts(record, analysis.config))
        return result_of_run(plan, piece, run, analysis.metrics, analysis.quality, analysis.criteria)

    def _recorded(self, test: _Test, bag: Path, monitor: RunMonitor) -> RunAnalysis:
        """Run a test; its bag gets its name when it is complete."""
        problem = ""

        def on_progress(description: str, begun: int) -> None:
            self.on_progress(f"{test.name}: {description}, {begun}/{test.motion.steps}")

        try:
            monitor.forget_run(_FORGETTING)
            recorded, problem = run_on_ros(
                test.config, COMPOSED_PROCESSES, monitor, self.interrupts, self.log, on_progress
            )
            analysis = test.analysis_of(recorded)
            os.replace(recorded, bag)
            return analysis
        except (RunFailed, InputError) as error:
            if self.interrupts:
                raise CampaignStopped(f"stopped during {test.name}") from error
            raise CampaignStopped(f"error: {test.name}: {problem or error}") from error
        finally:
            shutil.rmtree(self.bags / _UNFINISHED, ignore_errors=True)
