"""A table of your own: an ideal one, with the specimen on it as a rigid block."""

import numpy as np

from bmd_rths_core.table.controller import TableMeasurement


class MyTable:
    """A `TableController`; yours would speak to the hardware in `connect`, `exchange`, `stop` and `emergency_stop`."""

    by_steps = True  # a model: it moves with the commands. Leave this out for a table that moves with the clock.

    def __init__(self, config):
        self.masses, self.time_step = np.array(config.specimen.masses), config.run.time_step
        self.next_step = None  # not connected: no command is taken

    def connect(self):
        """Be ready for step 0, at rest; raise `RuntimeError` with one clear line where that cannot be."""
        self.next_step, self.held, self.velocity, self.displacement = 0, 0.0, 0.0, 0.0

    def exchange(self, command):
        """Hold the command for one step, and return the sensors at its end."""
        if self.next_step is None or command.step < self.next_step:
            raise RuntimeError(f"command of step {command.step} refused")
        skipped = command.step - self.next_step
        for held in [self.held] * skipped + [command.acceleration]:
            self.displacement += self.time_step * (self.velocity + 0.5 * self.time_step * held)
            self.velocity += self.time_step * held
        self.next_step, self.held = command.step + 1, command.acceleration
        shear = -self.held * self.masses.sum()
        floors = np.full(len(self.masses), self.held)
        return TableMeasurement(command.step, self.held, self.displacement, self.held, -shear, shear, floors)

    def stop(self):
        """Take no more commands."""
        self.next_step = None

    emergency_stop = close = stop

    def statistics(self):
        """Return what stands on /diagnostics, as texts."""
        return {"my_table": "rigid"}
