"""A rig in virtual time: stages, supervisor and virtual controller, with a network in memory between the last two."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.build import (
    make_command_shaper,
    make_force_correction,
    make_numerical_substructure,
    make_shear_estimator,
    make_stability_indicator,
    make_supervisor,
    make_virtual_controller,
)
from bmd_rths_core.safety import Action, bring_to_rest
from bmd_rths_core.table.controller import NoAnswer, TableCommand, TableMeasurement
from bmd_rths_core.table.emulated.faults import Faults, FaultyNetwork, parse_fault
from bmd_rths_core.table.wire import (
    ArmMode,
    ControllerPacket,
    ControllerState,
    HostPacket,
    Kind,
    Rejection,
    decode_controller_packet,
    encode_host_packet,
    interlock_names,
)

HOST, STRANGER = ("127.0.0.1", 1), ("127.0.0.1", 2)
SESSION = 7


@dataclass(frozen=True)
class Trial:
    """A test with a fault.

    Parameters
    ----------
    fault : str
        The fault, in words.
    config : Config
        Configuration of the test.
    begins : int
        Step of the fault.
    faults : tuple of str
        Of network, controller and table, as `parse_fault` takes them.
    command, shear : callable, optional
        What step and value of the command before the supervisor, and of the corrected shear, are turned into.
    beside : callable, optional
        What else happens to the link at each step.
    dies : bool
        The host sends nothing more from that step on.
    must_end : bool
        A test that goes on would be wrong.
    can_rest : bool
        False when nobody can bring the table to rest any more.
    """

    fault: str
    config: Config
    begins: int
    faults: tuple[str, ...] = ()
    command: Callable[[int, float], float] | None = None
    shear: Callable[[int, float], float] | None = None
    beside: Callable[[Link, int], None] | None = None
    dies: bool = False
    must_end: bool = False
    can_rest: bool = True


class Link:
    """The udp table controller without a socket: the same packets and time-outs, in virtual time."""

    def __init__(self, config: Config, faults: Faults) -> None:
        self._config = config
        self._step_ns = config.run.time_step_ns
        self.controller = make_virtual_controller(config, faults)
        self._there, self._back = (FaultyNetwork(faults, 2 * config.run.seed + i) for i in range(2))
        self._arriving: list[tuple[int, int, bytes]] = []
        self._returning: list[tuple[int, int, bytes]] = []
        self._inbox: list[bytes] = []
        self._number = self._sequence = 0
        self.now = self._due = 10**9

    def connect(self) -> None:
        self._asked(Kind.ARM, ArmMode.REAL_TIME)

    def exchange(self, command: TableCommand) -> TableMeasurement:
        self.wait(self._due)
        self._due = self.now + self._step_ns
        sequence = self._send(Kind.COMMAND, command.step, command.acceleration)
        answer = self._answer(sequence, self.now + round(self._config.table.answer_timeout * 1e9))
        if answer is None:
            raise NoAnswer
        if answer.state is not ControllerState.RUNNING:
            raise RuntimeError(
                f"controller is in state {answer.state.name.lower()} ({interlock_names(answer.interlock)})"
            )
        if answer.step != command.step:
            raise RuntimeError(f"controller answers step {command.step}, but the last one it applied is {answer.step}")
        return answer.measurement(command.acceleration)

    def stop(self) -> None:
        self._halt(Kind.STOP)

    def emergency_stop(self) -> None:
        self._halt(Kind.EMERGENCY_STOP)

    def close(self) -> None:
        """Nothing to release."""

    def statistics(self) -> Mapping[str, str]:
        return {}

    def stall(self, seconds: float) -> None:
        """Let the host do nothing for a time."""
        self.wait(self.now + round(seconds * 1e9))
        self._due = max(self._due, self.now)

    def intrude(self, kind: Kind, step: int, acceleration: float) -> None:
        """Send a packet of another host."""
        packet = HostPacket(kind, step, step, 0, acceleration, math.nan, math.nan, SESSION + 1)
        self.controller.receive(encode_host_packet(packet), STRANGER, self.now)

    def wait(self, until: int) -> None:
        """Let time pass."""
        while True:
            self._deliver()
            if self.now >= until:
                return
            self._to_next_event(until)

    def _to_next_event(self, until: int) -> None:
        queued = [queue[0][0] for queue in (self._arriving, self._returning) if queue]
        self.now = max(self.now, min(until, self.controller.next_event(self.now), *queued))

    def _deliver(self) -> None:
        controller = self.controller
        while self._arriving and self._arriving[0][0] <= self.now:
            controller.receive(heapq.heappop(self._arriving)[2], HOST, self.now)
        controller.advance(self.now)
        for answer in controller.answers():
            if answer.receiver == HOST:
                self._transmit(self._back, self._returning, answer.data)
        while self._returning and self._returning[0][0] <= self.now:
            self._inbox.append(heapq.heappop(self._returning)[2])

    def _transmit(self, network: FaultyNetwork, queue: list[tuple[int, int, bytes]], data: bytes) -> None:
        for due, arriving in network.transmit(data, self.now):
            self._number += 1
            heapq.heappush(queue, (due, self._number, arriving))

    def _send(self, kind: Kind, step: int = 0, acceleration: float = 0.0, sequence: int | None = None) -> int:
        if sequence is None:
            sequence = self._sequence
            self._sequence += 1
        packet = HostPacket(kind, sequence, step, 0, acceleration, math.nan, math.nan, SESSION)
        self._transmit(self._there, self._arriving, encode_host_packet(packet))
        return sequence

    def _answer(self, sequence: int, deadline: int) -> ControllerPacket | None:
        """Return the answer with a number, as soon as it is there."""
        floors = len(self._config.specimen.masses)
        while True:
            self._deliver()
            while self._inbox:
                packet = decode_controller_packet(self._inbox.pop(0), floors)
                if not isinstance(packet, Rejection) and (packet.session, packet.sequence) == (SESSION, sequence):
                    return packet
            if self.now >= deadline:
                return None
            self._to_next_event(deadline)

    def _asked(self, kind: Kind, step: int = 0) -> ControllerPacket | None:
        give_up = self.now + round(self._config.table.give_up_after * 1e9)
        sequence = self._send(kind, step)
        while (answer := self._answer(sequence, self.now + round(self._config.table.resend_after * 1e9))) is None:
            if self.now > give_up:
                return None
            self._send(kind, step, sequence=sequence)
        return answer

    def _halt(self, kind: Kind) -> None:
        give_up = self.now + round(self._config.table.stop_timeout * 1e9)
        answer = self._asked(kind)
        while answer is not None and answer.state is ControllerState.STOPPING and self.now < give_up:
            self.wait(self.now + round(self._config.table.resend_after * 1e9))
            answer = self._asked(Kind.STATUS)


class Rig:
    """A test in virtual time, as the nodes run it in real time."""

    def __init__(self, trial: Trial) -> None:
        config = trial.config
        self._trial = trial
        self._ground = select_ground_motion(config.ground_motion, config.run.time_step).acceleration.tolist()
        self.link = Link(config, Faults(parse_fault(text, config.virtual_controller.model) for text in trial.faults))
        self.supervisor = make_supervisor(config)
        self.steps = 0

    def run(self) -> tuple[str, str]:
        """Run the test and bring the table to rest; return how and why it ended."""
        self.link.connect()
        ended, reason = self._run_steps()
        self.ended_at = self.link.now
        if not self._trial.dies:
            try:
                bring_to_rest(self.link, self.supervisor)
            except RuntimeError as error:  # the controller has begun its own way to rest
                reason = f"{reason}; on the way to rest: {error}"
        return ended, reason

    def _run_steps(self) -> tuple[str, str]:
        trial, link, supervisor = self._trial, self.link, self.supervisor
        substructure, shaper = make_numerical_substructure(trial.config), make_command_shaper(trial.config)
        indicator, estimator = make_stability_indicator(trial.config), make_shear_estimator(trial.config)
        correction = make_force_correction(trial.config)
        feedback, misses = 0.0, 0
        for k, ground_acceleration in enumerate(self._ground):
            self.steps = k
            if trial.beside is not None:
                trial.beside(link, k)
            if trial.dies and k == trial.begins:
                return "failed", "the host is dead"
            response = substructure.step(ground_acceleration, feedback)
            unstable = indicator.step(k, feedback, substructure.displacements)
            if unstable is not None and unstable.action > Action.INDICATE:
                supervisor.record([unstable])
                return "limit", supervisor.reason
            command = shaper.step(response.desired_acceleration)
            if trial.command is not None:
                command = trial.command(k, command)
            if not supervisor.check(k, command):
                return "limit", supervisor.reason
            try:
                measurement = link.exchange(TableCommand(k, command))
            except NoAnswer:
                misses += 1
                if misses > trial.config.run.max_consecutive_misses:
                    return "failed", f"more than {misses - 1} deadlines in a row were missed"
                continue
            except RuntimeError as error:
                supervisor.request(Action.EMERGENCY_STOP)
                return "failed", str(error)
            misses = 0
            supervisor.observe(measurement)
            feedback = correction.step(response.required_force, estimator.step(measurement))
            if trial.shear is not None:
                feedback = trial.shear(k, feedback)
        return "finished", "end of the ground motion"
