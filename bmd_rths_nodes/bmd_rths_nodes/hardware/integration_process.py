"""The numerical substructure in a process of its own: it integrates while the loop goes on.

A thread would not do. Stories in Python hold the interpreter for as long as they like, and the loop with it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import json
import os
import select
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from bmd_rths_core.config import Config, config_from_mapping
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.substeps import WARNED_PART, longest_integration
from bmd_rths_core.loop.build import make_numerical_substructure
from bmd_rths_core.loop.substepped_stage import (
    Integrated,
    IntegrationLate,
    bytes_of_target,
    next_target,
    target_of_bytes,
)

if TYPE_CHECKING:
    from bmd_rths_core.record import FloatArray

#: Longest wait for the process to be ready before a test [s].
READY_TIMEOUT = 30.0

#: What is asked: how often something was asked before, whether to return to rest, and three loads.
_ASKED = struct.Struct("<q?ddd")
#: What is answered before a target: the number of the question, and when it was there [s].
_ANSWERED = struct.Struct("<qd")

#: Integrations before the first one that counts: the first call of everything is slow.
_WARM_UP = 5


class IntegrationProcess:
    """Compute targets in a process of its own, as `bmd_rths_core.loop.substepped_stage.Integration`.

    Parameters
    ----------
    config : Config
        The whole configuration, with sub-steps.
    module : str, optional
        What the process runs, which calls `serve`.

    Attributes
    ----------
    count, slow : int
        Targets since the reset, and how many of them took longer than 60 % of N Δt, or as much less as the hand-over is
        earlier than at 80 %.
    longest : float
        Longest time from the question to the target [s].

    Raises
    ------
    InputError
        The process is not ready in time.

    Notes
    -----
    Nothing here waits while a test runs: a question is written to a pipe that is empty, and an answer is read if it is
    there. The process ends with its input.
    """

    def __init__(self, config: Config, module: str = __name__) -> None:
        substeps, time_step = config.numerical_substructure.substeps, config.run.time_step
        self._allowed = longest_integration(substeps, time_step)
        self._whole = substeps * time_step
        self._size = _ANSWERED.size + 8 * (2 * len(config.numerical_substructure.masses) + 1)
        self._asked, self._asked_at, self._part = 0, 0.0, b""
        self.count, self.slow, self.longest = 0, 0, 0.0
        self._process = subprocess.Popen(
            [sys.executable, "-m", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,  # Ctrl-C on the terminal is for the test
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input, self._output = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._output, False)
        told = json.dumps(config.as_mapping()).encode()
        with contextlib.suppress(BrokenPipeError):  # `reset` finds out
            _write(self._input, struct.pack("<q", len(told)) + told)

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        for pipe in (self._process.stdin, self._process.stdout):
            pipe.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def reset(self, ground_acceleration: float) -> None:
        """Return to rest at target 0, and wait until the process is there; raises `InputError` where it is not."""
        self.count, self.slow, self.longest = 0, 0, 0.0
        try:
            self._ask(True, 0.0, ground_acceleration, 0.0)
            until = time.perf_counter() + READY_TIMEOUT
            while self._answered() is None:
                wait = until - time.perf_counter()
                if wait <= 0.0 or not select.select([self._output], [], [], wait)[0]:
                    raise InputError(
                        f"numerical_substructure.substeps: its process was not ready within {READY_TIMEOUT:g} s"
                    )
        except IntegrationLate as gone:
            raise InputError(str(gone)) from gone

    def start(self, correction: float, ground_acceleration: float, feedback_force: float) -> None:
        """Have the next target computed."""
        self._ask(False, correction, ground_acceleration, feedback_force)

    def target(self) -> FloatArray:
        """Return the target if it is there."""
        answer = self._answered()
        if answer is None:
            raise IntegrationLate(
                f"numerical_substructure.substeps: an integration was not there after {1e3 * self._allowed:.3g} ms, "
                f"{100.0 * self._allowed / self._whole:.0f} % of its steps; more of them or fewer stories are required"
            )
        _, there_at = _ANSWERED.unpack_from(answer)
        duration = there_at - self._asked_at
        self.count += 1
        self.longest = max(self.longest, duration)
        self.slow += duration > WARNED_PART * self._allowed
        return target_of_bytes(answer[_ANSWERED.size :])

    def _ask(self, to_rest: bool, *loads: float) -> None:
        self._asked += 1
        self._asked_at = time.perf_counter()
        try:
            os.write(self._input, _ASKED.pack(self._asked, to_rest, *loads))
        except BrokenPipeError:
            raise self._gone() from None

    def _answered(self) -> bytes | None:
        """Return the answer if it is there; those to older questions, of a test that has ended, are left out."""
        while True:
            try:
                data = os.read(self._output, self._size - len(self._part))
            except BlockingIOError:
                return None
            if not data:
                raise self._gone()
            self._part += data
            if len(self._part) == self._size:
                answer, self._part = self._part, b""
                if _ANSWERED.unpack_from(answer)[0] == self._asked:
                    return answer

    def _gone(self) -> IntegrationLate:
        return IntegrationLate("numerical_substructure.substeps: the process that integrates has ended")


def serve(make: Callable[[Config], Integrated] = make_numerical_substructure) -> int:
    """Integrate what is asked for on the standard input, until it ends.

    Parameters
    ----------
    make : callable
        Returns the numerical substructure of a configuration.
    """
    (length,) = struct.unpack("<q", sys.stdin.buffer.read(8))
    config = config_from_mapping(json.loads(sys.stdin.buffer.read(length)))
    _stand_back(config)
    model, mass = make(config), config.elastic_substructure().interface_mass
    _to_rest(model, mass, 0.0)
    gc.collect()
    gc.freeze()
    target = bytes_of_target(next_target(model, mass, 0.0, 0.0, 0.0))
    while len(data := sys.stdin.buffer.read(_ASKED.size)) == _ASKED.size:
        asked, to_rest, correction, ground, force = _ASKED.unpack(data)
        if to_rest:
            _to_rest(model, mass, ground)
        else:
            target = bytes_of_target(next_target(model, mass, correction, ground, force))
        try:
            _write(sys.stdout.fileno(), _ANSWERED.pack(asked, time.perf_counter()) + target)
        except BrokenPipeError:
            break
    return 0


def _write(pipe: int, data: bytes) -> None:
    """Write all of it, however many pieces that takes."""
    while data:
        data = data[os.write(pipe, data) :]


def _to_rest(model: Integrated, mass: float, ground: float) -> None:
    """Return to rest at target 0, after some integrations that do not count."""
    model.reset()
    for _ in range(_WARM_UP):
        next_target(model, mass, 0.0, ground, 0.0)
    model.reset()
    model.step(ground, 0.0)


def _stand_back(config: Config) -> None:
    """Stay off the processor of the loop, and give way to it; what the loop has is inherited."""
    from bmd_rths_nodes.ros.real_time import enter_real_time

    real_time = config.real_time
    if real_time.processor >= 0:
        others = set(range(os.cpu_count() or 1)) - {real_time.processor}
        with contextlib.suppress(OSError):  # there is no other one
            os.sched_setaffinity(0, others)
    if real_time.priority == 1:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    enter_real_time(dataclasses.replace(real_time, processor=-1, priority=max(0, real_time.priority - 1)))


if __name__ == "__main__":
    sys.exit(serve())
