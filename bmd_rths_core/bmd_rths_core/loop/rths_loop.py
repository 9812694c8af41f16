"""The loop in process: the stages of the paper's Figure 3 between conductor and table driver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.loop.build import (
    make_calibration,
    make_command_shaper,
    make_force_correction,
    make_numerical_stage,
    make_shear_estimator,
    make_stability_indicator,
    make_supervisor,
    make_table_controller,
)
from bmd_rths_core.loop.conductor import Begun, Conductor
from bmd_rths_core.loop.hosting import Clock, VirtualClock, ending, run_to_rest
from bmd_rths_core.loop.states import Outcome
from bmd_rths_core.loop.table_driver import TableDriver
from bmd_rths_core.record import RunRecord, empty_signals, provenance
from bmd_rths_core.rest_record import rest_record
from bmd_rths_core.table.controller import TableCommand, TableController, TableMeasurement

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
    clock : Clock, optional
        Steps begin by this clock; by default they follow each other, in lockstep.

    Attributes
    ----------
    conductor : Conductor
        Begins the steps.
    driver : TableDriver
        Moves the table.
    supervisor : SafetySupervisor
        What is in the path of the command; it knows the limits that were passed.
    stability_indicator : StabilityIndicator
        What watches the numerical substructure.
    """

    def __init__(
        self,
        config: Config,
        motion: GroundMotion,
        table: TableController | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._config, self._motion = config, motion
        self._clock = clock or VirtualClock()
        lockstep, time_step = clock is None, config.run.time_step
        self._command_shaper = make_command_shaper(config)
        self._shear_estimator = make_shear_estimator(config)
        self._force_correction = make_force_correction(config)
        self._numerical = make_numerical_stage(config, motion.acceleration)
        self.stability_indicator = make_stability_indicator(config)
        self.supervisor = make_supervisor(config)
        self.driver = TableDriver(
            table if table is not None else make_table_controller(config),
            self.supervisor,
            time_step,
            lockstep,
            self._on_measurement,
            self._on_rest_command,
            self._on_rest_measurement,
            make_calibration(config),
        )
        self.conductor = Conductor(
            motion.acceleration.tolist(),
            self._numerical,
            self.stability_indicator,
            time_step,
            lockstep,
            config.run.longest_miss_time,
            self._on_step,
        )

    def run(self, progress: Callable[[int], None] | None = None) -> RunRecord:
        """Run the whole ground motion from rest.

        Parameters
        ----------
        progress : callable, optional
            Called with the number of finished steps every `PROGRESS_PERIOD` steps and at the end.

        Returns
        -------
        RunRecord
            Outcome ``"finished"``, ``"limit"`` when a limit was passed, or ``"failed"``, also when the table did not
            confirm its stop. After a limit the record ends with the step whose command was refused, without sensors, or
            before the step at which the stability indicator was too large. The way to rest that follows every test
            stands apart, in ``way_to_rest``.

        Raises
        ------
        OSError, RuntimeError
            The table controller cannot be connected.
        """
        self._progress = progress
        self._signals = empty_signals(self._motion.steps, len(self._config.specimen.masses))
        self._required: dict[int, float] = {}
        self._rest_commands: dict[int, float] = {}
        self._rest_measurements: dict[int, TableMeasurement] = {}
        self._command_shaper.reset()
        self._shear_estimator.reset()
        self._force_correction.reset()
        run_to_rest(self.conductor, self.driver, self._clock)
        self.supervisor.record(self.conductor.trips)
        conductor = self.conductor
        outcome, reason = ending(conductor, self.driver)
        if progress is not None and conductor.outcome is Outcome.FINISHED:
            progress(conductor.step)
        recorded: dict[str, Any] = {name: signal[: conductor.step] for name, signal in self._signals.items()}
        return RunRecord(
            time_step=self._config.run.time_step,
            outcome=str(outcome),
            reason=reason,
            way_to_rest=rest_record(self._rest_commands, self._rest_measurements, len(self._config.specimen.masses)),
            **recorded,
            **provenance(self._config.as_mapping(), self._motion),
        )

    def _on_step(self, begun: Begun) -> None:
        step, signals = begun.step, self._signals
        command = self._command_shaper.step(begun.command)
        signals["ground_acceleration"][step] = begun.ground_acceleration
        signals["desired_acceleration"][step] = begun.desired_acceleration
        signals["required_force"][step] = begun.required_force
        signals["command"][step] = command
        self._required[step] = begun.required_force
        self.driver.command(step, command, self._clock.now())

    def _on_measurement(self, measurement: TableMeasurement) -> None:
        step, signals = measurement.step, self._signals
        self.conductor.measured(measurement, self._clock.now())
        self._command_shaper.learn(measurement)
        shear = self._shear_estimator.step(measurement)
        feedback = self._force_correction.step(self._required.pop(step), shear)
        signals["applied_command"][step] = measurement.applied_command
        signals["table_displacement"][step] = measurement.table_displacement
        signals["table_acceleration"][step] = measurement.table_acceleration
        signals["actuator_force"][step] = measurement.actuator_force
        signals["base_shear"][step] = measurement.base_shear
        signals["floor_accelerations"][step] = measurement.floor_accelerations
        signals["interface_force"][step] = shear
        signals["corrected_force"][step] = feedback
        self.conductor.shear(step, feedback, self._clock.now())
        if self._progress is not None and (step + 1) % PROGRESS_PERIOD == 0:
            self._progress(step + 1)

    def _on_rest_command(self, command: TableCommand) -> None:
        self._rest_commands[command.step] = command.acceleration

    def _on_rest_measurement(self, measurement: TableMeasurement) -> None:
        self._rest_measurements[measurement.step] = measurement
