"""What every part of a run has to agree on, and where it is recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from bmd_rths_core.compensators.registry import compensators
from bmd_rths_core.errors import InputError
from bmd_rths_core.parameters import check_parameters, parameter
from bmd_rths_core.time_steps import StepStamps

#: Longest time step of the loop, and of an integration [s].
LONGEST_STEP = 0.1

#: A time step of so many seconds looks like a rate in Hz.
_LEAST_RATE = 10.0


@dataclass(frozen=True)
class RunConfig:
    """What every part of a run has to agree on."""

    SECTION: ClassVar[str] = "run"

    time_step: float = parameter(
        0.005,
        description="Time step of the loop",
        unit="s",
        source="Chen et al. 2020: 200 Hz",
        lower=1e-4,
        upper=LONGEST_STEP,
    )
    scheme: str = parameter(
        "plc_fc",
        description="Compensator, by its name; docs/reference/compensators.md describes them",
        source="Chen et al. 2020, Table 2",
        choices=tuple(compensators()),
    )
    lockstep: bool = parameter(
        False, description="Start each step when the last one has closed, instead of by the wall clock"
    )
    record: bool = parameter(True, description="Wait for the recorder before step 0, so that every step is recorded")
    seed: int = parameter(
        0, description="Seed of everything random in simulated parts", unit="1", lower=0, upper=2**31 - 1
    )
    longest_miss_time: float = parameter(
        0.1,
        description="Longest time in which one deadline after the other is missed; after more the test is stopped",
        unit="s",
        source="assumed: 20 steps at 200 Hz",
        lower=0.0,
        upper=600.0,
    )
    settling_time: float = parameter(
        3.5,
        description="Shortest time from the start of the driver of a real table until it is ready in real time: "
        "whoever else publishes to it is discovered by then",
        unit="s",
        source="docs/decisions/0004: Fast DDS repeats its announcements every 3 s",
        lower=0.0,
        upper=60.0,
    )
    preflight: str = parameter(
        "enforce",
        description="What `bmd-rths run` does before a test whose prediction passes a limit or is not stable: enforce "
        "refuses it, override runs it all the same, skip predicts nothing",
        source="docs/decisions/0011",
        choices=("enforce", "override", "skip"),
    )

    def __post_init__(self) -> None:
        """Check the values."""
        if self.time_step >= _LEAST_RATE:
            step = f"{1.0 / self.time_step:g} s"
            raise InputError(
                f"run.time_step: {self.time_step:g} s is not allowed; >= 0.0001 s and <= 0.1 s is required "
                f"({self.time_step:g} Hz, if that is meant, are {step})"
            )
        check_parameters(self)

    @property
    def stamps(self) -> StepStamps:
        """Message stamps of the steps."""
        return StepStamps(self.time_step)


#: Shortest time slice that Linux gives to a thread of the ordinary scheduler [s].
SHORTEST_TIME_SLICE = 1e-4


@dataclass(frozen=True)
class RealTimeConfig:
    """What the processes of the loop ask Linux for in real time; each may have its own."""

    SECTION: ClassVar[str] = "real_time"

    priority: int = parameter(
        0,
        description="Real-time priority (SCHED_FIFO) of every thread of a process; 0 leaves the ordinary scheduler",
        unit="1",
        source="sched(7); 99 is left to the kernel",
        lower=0,
        upper=98,
    )
    lock_memory: bool = parameter(
        False, description="Keep the memory of a process from being moved to disk", source="mlockall(2)"
    )
    time_slice: float = parameter(
        SHORTEST_TIME_SLICE,
        description="Time that the ordinary scheduler lets a thread of the loop run before others: the shorter, the "
        "sooner it runs when a message comes. Linux 6.12 or later; 0 leaves it to the kernel",
        unit="s",
        source="sched_setattr(2), EEVDF",
        lower=0.0,
        upper=0.1,
    )
    processor: int = parameter(
        -1,
        description="Number of the processor that the loop of a process stays on; -1 leaves that to the kernel",
        unit="1",
        source="sched_setaffinity(2)",
        lower=-1,
        upper=1023,
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)
        if 0.0 < self.time_slice < SHORTEST_TIME_SLICE:
            raise InputError(
                f"real_time.time_slice: {self.time_slice:g} s; 0, or {SHORTEST_TIME_SLICE:g} s or more, is required"
            )


@dataclass(frozen=True)
class RecorderConfig:
    """Where and how a test is recorded."""

    SECTION: ClassVar[str] = "recorder"

    directory: str = parameter("bags", description="Folder the bag of a test is written into")
    flush_period: float = parameter(
        0.1, description="Longest time recorded data stay in memory", unit="s", lower=0.01, upper=1.0
    )

    def __post_init__(self) -> None:
        """Check the values."""
        check_parameters(self)
        if not self.directory:
            raise InputError("recorder.directory: empty; the path of a folder is required")
