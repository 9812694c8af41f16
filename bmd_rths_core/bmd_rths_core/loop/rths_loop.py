"""The loop in process: the five stages in the order of the paper's Figure 3, one closed step after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.build import (
    make_command_shaper,
    make_force_correction,
    make_numerical_substructure,
    make_shear_estimator,
    make_stability_indicator,
    make_supervisor,
    make_table_controller,
)
from bmd_rths_core.record import FloatArray, RunRecord, empty_signals, provenance
from bmd_rths_core.safety import bring_to_rest
from bmd_rths_core.table.controller import TableCommand, TableController

#: How often `RthsLoop.run` reports progress [steps].
PROGRESS_PERIOD = 200


class RthsLoop:
    """Run a test in process.

    Parameters
    ----------
    config : Config
        Configuration of the test.
    motion : GroundMotion
        Ground motion with one sample a step.
    table : TableController, optional
        Used instead of the configured one.

    Attributes
    ----------
    supervisor : SafetySupervisor
        What is in the path of the command; it knows the limits that were passed.
    stability_indicator : StabilityIndicator
        What watches the numerical substructure.
    """

    def __init__(self, config: Config, motion: GroundMotion, table: TableController | None = None) -> None:
        self._config = config
        self._motion = motion
        self._numerical_substructure = make_numerical_substructure(config)
        self._command_shaper = make_command_shaper(config)
        self.stability_indicator = make_stability_indicator(config)
        self.supervisor = make_supervisor(config)
        self._table = table if table is not None else make_table_controller(config)
        self._shear_estimator = make_shear_estimator(config)
        self._force_correction = make_force_correction(config)

    def run(self, progress: Callable[[int], None] | None = None) -> RunRecord:
        """Run the whole ground motion from rest.

        Parameters
        ----------
        progress : callable, optional
            Called with the number of finished steps every `PROGRESS_PERIOD` steps and at the end.

        Returns
        -------
        RunRecord
            Outcome ``"finished"``, or ``"limit"`` when a limit was passed. The record then ends with the step whose
            command was refused, without sensors, or before the step at which the stability indicator was too large.
            The ramp to rest that follows every test is not recorded.
        """
        ground = self._motion.acceleration
        signals = empty_signals(len(ground), len(self._config.specimen.masses))
        self._table.connect()
        try:
            steps, outcome, reason = self._run_steps(ground, signals, progress)
            bring_to_rest(self._table, self.supervisor)
        finally:
            self._table.stop()
            self._table.close()
        recorded: dict[str, Any] = {name: signal[:steps] for name, signal in signals.items()}
        return RunRecord(
            time_step=self._config.run.time_step,
            outcome=outcome,
            reason=reason,
            **recorded,
            **provenance(self._config.as_mapping(), self._motion),
        )

    def _run_steps(
        self, ground: FloatArray, signals: dict[str, FloatArray], progress: Callable[[int], None] | None
    ) -> tuple[int, str, str]:
        stages = (self._numerical_substructure, self._command_shaper, self._shear_estimator)
        for stage in (*stages, self.stability_indicator, self.supervisor):
            stage.reset()
        feedback = 0.0
        for k, ground_acceleration in enumerate(ground.tolist()):
            response = self._numerical_substructure.step(ground_acceleration, feedback)
            unstable = self.stability_indicator.step(k, feedback, self._numerical_substructure.displacements)
            if unstable is not None:
                self.supervisor.record([unstable])
                if self.supervisor.reason:
                    return k, "limit", self.supervisor.reason
            command = self._command_shaper.step(response.desired_acceleration)
            signals["ground_acceleration"][k] = ground_acceleration
            signals["desired_acceleration"][k] = response.desired_acceleration
            signals["required_force"][k] = response.required_force
            signals["command"][k] = command
            if not self.supervisor.check(k, command):
                return k + 1, "limit", self.supervisor.reason
            measurement = self._table.exchange(TableCommand(k, command))
            self.supervisor.observe(measurement)
            shear = self._shear_estimator.step(measurement)
            feedback = self._force_correction.step(response.required_force, shear)
            signals["applied_command"][k] = measurement.applied_command
            signals["table_displacement"][k] = measurement.table_displacement
            signals["table_acceleration"][k] = measurement.table_acceleration
            signals["actuator_force"][k] = measurement.actuator_force
            signals["base_shear"][k] = measurement.base_shear
            signals["floor_accelerations"][k] = measurement.floor_accelerations
            signals["interface_force"][k] = shear
            signals["corrected_force"][k] = feedback
            if progress is not None and (k + 1) % PROGRESS_PERIOD == 0:
                progress(k + 1)
        if progress is not None:
            progress(len(ground))
        return len(ground), "finished", "end of the ground motion"
