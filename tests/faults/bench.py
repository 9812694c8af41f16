"""A bench for faults: a run of real processes with the table of `bmd-rths emulate`, in real time on this machine."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
from pathlib import Path
from typing import Any

from tests.nodes.conftest import CONFIG, Child, processes_of_domain, wait_until

#: Long steps and patience, so that the fault decides and not a busy machine; a building too heavy to feel the shear.
SETTINGS = {
    "run.time_step": 0.02,
    "table.answer_timeout": 0.012,
    "numerical_substructure.masses": [8.0e6],
    "ground_motion.time_scale": 1.0,
    "ground_motion.duration": 20.0,
    "ground_motion.peak_acceleration": 0.3,
    "safety.ramp_acceleration": 0.5,
    "safety.velocity_limit": 0.4,  # so that the longest way to rest, for which a silent recorder is waited, is short
    "run.longest_miss_time": 2.0,
    "run.preflight": "skip",
    "run.settling_time": 0.0,  # nobody else is on the domain
    "safety.stale_shear_time": 2.0,
    "safety.stale_controller_time": 2.0,
}
#: Silence of the host after which the controller brings the table to rest [s]. It holds the last command until then;
#: the small accelerations above leave the table within its stroke, which 5 m/s² would not.
WATCHDOG = 0.5


def _arguments(settings: dict[str, Any]) -> list[str]:
    return [word for name, value in settings.items() for word in ("--set", f"{name}={json.dumps(value)}")]


class Bench:
    """An emulator and a run with it, in a folder and on the ROS domain of the environment."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.domain = int(os.environ["ROS_DOMAIN_ID"])
        self.children: list[Child] = []

    def start(self, *arguments: object, environment: dict[str, str] | None = None) -> Child:
        """Start Python with arguments."""
        folder = self.folder / f"child_{len(self.children)}"
        folder.mkdir()
        before = dict(os.environ)
        os.environ.update(environment or {})
        try:
            self.children.append(Child(folder, [str(argument) for argument in arguments]))
        finally:
            os.environ.clear()
            os.environ.update(before)
        return self.children[-1]

    def bmd_rths(self, *arguments: object, **options: Any) -> Child:
        """Start the command line."""
        return self.start("-m", "bmd_rths_nodes.cli.main", *arguments, **options)

    def emulate(self, faults: tuple[str, ...] = (), port: int = 0) -> Child:
        """Start an emulator."""
        options = [word for fault in faults for word in ("--fault", fault)]
        watchdog = ("--set", f"virtual_controller.watchdog={WATCHDOG}")
        return self.bmd_rths("emulate", CONFIG, "--listen", f"udp://127.0.0.1:{port}", "--json", *watchdog, *options)

    def begin(self, composed: bool, faults: tuple[str, ...] = (), environment: dict[str, str] | None = None) -> None:
        """Start emulator and run."""
        self.emulator = self.emulate(faults)
        ready = json.loads(wait_until(lambda: self.emulator.output.read_text().partition("\n")[0]))
        self.port, self._control_port = ready["port"], ready["control_port"]
        self.bags = self.folder / "bags"
        how = ("--composed",) if composed else ()
        self.run = self.bmd_rths(*self.run_arguments(self.bags), *how, environment=environment)

    def run_arguments(self, output: Path) -> list[object]:
        """Return the arguments of a run with the emulator."""
        settings = _arguments(SETTINGS)
        table = ("--table", f"udp://127.0.0.1:{self.port}")
        return ["run", CONFIG, "--scheme", "uc", *table, *settings, "--output", output, "--json"]

    def tell(self, line: str) -> dict[str, Any]:
        """Say something on the control port of the emulator and return what it says."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
            control.settimeout(20.0)
            control.sendto(line.encode(), ("127.0.0.1", self._control_port))
            return json.loads(control.recv(4096))

    def until_step(self, step: int) -> None:
        """Wait until the controller has got about as many commands, or the run has ended."""
        wait_until(lambda: self.run.process.poll() is not None or self.tell("status").get("received", 0) > step)

    def process_of(self, name: str) -> int:
        """Return the process id of a node."""
        found = [pid for pid, command in processes_of_domain(self.domain).items() if f".{name}" in command]
        assert len(found) == 1, f"{name}: {found}"
        return found[0]

    def close(self) -> None:
        """End every process that is left."""
        for child in self.children:
            if child.process.poll() is None:
                child.process.send_signal(signal.SIGCONT)
                child.process.send_signal(signal.SIGINT)
        for child in self.children:
            try:
                child.process.wait(10.0)
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()
