"""Who ends `commission` while the table moves ends it in order: a ramp to rest first, then an emergency stop."""

import os
import signal

import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.identification import excited_table
from bmd_rths_core.identification.excited_table import DrivingStopped
from bmd_rths_nodes.cli import commission


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_brings_the_table_to_rest(monkeypatch, number):
    drive, commands = excited_table.drive, []

    def interrupted(table, *arguments, **options):
        exchange = table.exchange

        def noted(command):
            commands.append(command.acceleration)
            if command.step == 1000:
                os.kill(os.getpid(), number)
            return exchange(command)

        table.exchange = noted
        return drive(table, *arguments, **options)

    monkeypatch.setattr(excited_table, "drive", interrupted)
    with pytest.raises(DrivingStopped, match=r"^stopped by the operator$"):
        commission._driven(Config())
    assert 1000 < len(commands) < 1600
    assert sum(commands) == pytest.approx(0.0, abs=1e-9)  # no velocity is left
