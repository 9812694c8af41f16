"""Excitation: within its band and its limits, from rest to rest."""

from dataclasses import replace

import numpy as np
import pytest

from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.identification.excitation import ExcitationSettings, displacement_of, excitation_command
from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.models.simulated import SimulatedTable
from bmd_rths_core.table.models.simulated_config import SimulatedTableConfig

DT = 0.005
SHORT = ExcitationSettings(duration=60.0)
SWEEP = replace(SHORT, kind="sweep", amplitude=0.4)


@pytest.mark.parametrize("settings", [SHORT, replace(SHORT, seed=7), SWEEP, replace(SWEEP, amplitude=2.0)])
def test_ends_at_rest_within_the_limits(settings):
    command = excitation_command(settings, DT)
    assert np.abs(command).max() == pytest.approx(settings.amplitude, rel=1e-12)
    assert DT * command.sum() == pytest.approx(0.0, abs=1e-12)
    displacement = displacement_of(command, DT)
    assert np.abs(displacement).max() < settings.stroke
    assert displacement[-1] == pytest.approx(0.0, abs=1e-10)
    assert not command[:400].any()
    assert not command[-1000:].any()


def test_displacement_is_that_of_a_perfect_simulated_table():
    command = excitation_command(SHORT, DT)
    config = SimulatedTableConfig(dynamics="perfect", displacement_noise=0.0)
    table = SimulatedTable(config, Config().specimen.building(), DT, seed=0)
    measured = [table.exchange(TableCommand(k, a)).table_displacement for k, a in enumerate(command.tolist())]
    assert displacement_of(command, DT) == pytest.approx(np.array(measured), abs=1e-9)


@pytest.mark.parametrize("settings", [SHORT, SWEEP])
def test_power_is_within_the_band(settings):
    power = np.abs(np.fft.rfft(excitation_command(settings, DT))) ** 2
    frequency = np.fft.rfftfreq(2 * (len(power) - 1), DT)
    outside = (frequency < 0.4) | (frequency > 25.5)
    assert power[outside].sum() < 2e-3 * power.sum()
    # Every octave is excited.
    for lowest in (0.6, 1.2, 2.4, 4.8, 9.6):
        octave = (frequency > lowest) & (frequency < 2 * lowest)
        assert np.median(power[octave]) > 1e-2 * np.median(power[~outside])


def test_noise_is_flat_with_low_peaks_and_comes_from_the_seed():
    command = excitation_command(SHORT, DT)
    middle = command[2000:-2000]
    assert np.abs(command).max() / middle.std() < 2.5
    again, other = excitation_command(SHORT, DT), excitation_command(replace(SHORT, seed=1), DT)
    assert np.array_equal(command, again)
    assert abs(np.corrcoef(command, other)[0, 1]) < 0.1


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"kind": "hammer"}, "noise, sweep"),
        ({"amplitude": 30.0}, "250 mm are allowed"),
        ({"stroke": 0.01}, "10 mm are allowed"),
        ({"amplitude": 0.0}, "amplitude 0"),
        ({"amplitude": float("nan")}, "amplitude nan"),
        ({"stroke": -1.0}, "stroke -1"),
        ({"duration": 5.0}, "duration 5 s"),
        ({"band": (10.0, 10.0)}, "rising band"),
        ({"band": (0.0, 10.0)}, "rising band"),
        ({"band": (1.0, 600.0)}, "<= 80 Hz"),
    ],
)
def test_what_is_not_allowed_is_refused_in_one_line(changes, expected):
    with pytest.raises(InputError, match=expected) as error:
        excitation_command(replace(SHORT, **changes), DT)
    assert "\n" not in str(error.value)
