"""Real files of the agencies: the peak, its time and its velocity are those of their headers."""

from __future__ import annotations

import numpy as np
import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion import read_ground_motion
from bmd_rths_core.ground_motion.catalogue import catalogue, record_files
from bmd_rths_core.ground_motion.intensity import peak_velocity
from tests.conftest import ground_motion_folder, needs
from tests.core.test_record_formats import refusal

FOLDER = ground_motion_folder() / "formats"
needs_records = needs(FOLDER)

#: File, component, time step [s], points; peak [m/s²] and its digit, as the index or the file's own header give them.
REAL = (
    ("test.knet", "E-W", 0.01, 5900, 0.04383, 1e-5),
    ("AICH040010061330.NS2", "N-S surface", 0.005, 28600, 0.05605, 1e-5),
    ("us1000hyfh_akbmrp_AKBMR--n.1000hyfh.BNZ.--.acc.V2c", "BNZ", 0.005, 42000, 0.068515, 1e-6),
    ("ce36456p_CE36456.V2", "90 DEG", 0.02, 3251, 2.67957, 1e-5),
    ("ce36456p_CE36456.V2", "UP", 0.02, 3250, 0.94805, 1e-5),
    ("ce36456p_CE36456.V2", "0 DEG", 0.02, 3250, 2.56231, 1e-5),
    ("20180212_211557_WPWS_20.V2A", "S16W", 0.02, 5800, 0.0416, 1e-4),
    ("20180212_211557_WPWS_20.V2A", "S74E", 0.02, 5800, 0.1940, 1e-4),
    ("20180212_211557_WPWS_20.V2A", "Up", 0.02, 5800, 0.0273, 1e-4),
    # the largest absolute values of the lines AmplitudeMAX, with the offset of the file
    ("1-EAS.dat", "U", 0.02, 6000, 0.00837, 1e-5),
    ("1-EAS.dat", "N", 0.02, 6000, 0.02273, 1e-5),
    ("1-EAS.dat", "E", 0.02, 6000, 0.01017, 1e-5),
)


@needs_records
@pytest.mark.parametrize(("file", "component", "time_step", "steps", "peak", "digit"), REAL)
def test_real_file_has_the_peak_of_its_header(
    file: str, component: str, time_step: float, steps: int, peak: float, digit: float
) -> None:
    motion = read_ground_motion(FOLDER / file, component)
    assert (motion.time_step, motion.steps) == (time_step, steps)
    assert motion.peak == pytest.approx(peak, abs=0.5001 * digit)


@needs_records
@pytest.mark.parametrize(
    ("file", "component", "time"),
    [
        ("us1000hyfh_akbmrp_AKBMR--n.1000hyfh.BNZ.--.acc.V2c", "BNZ", 76.215),
        ("ce36456p_CE36456.V2", "90 DEG", 10.940),
        ("ce36456p_CE36456.V2", "0 DEG", 7.740),
        ("20180212_211557_WPWS_20.V2A", "S74E", 5.0 + 43.66),  # counted from 5 s after the first point
    ],
)
def test_real_file_has_its_peak_at_the_time_of_its_header(file: str, component: str, time: float) -> None:
    motion = read_ground_motion(FOLDER / file, component)
    assert np.argmax(np.abs(motion.acceleration)) * motion.time_step == pytest.approx(time, abs=1e-9)


@needs_records
@pytest.mark.parametrize(
    ("file", "component", "velocity"),
    [
        ("ce36456p_CE36456.V2", "90 DEG", 0.28253 - 0.00052),  # its header gives an initial velocity
        ("ce36456p_CE36456.V2", "UP", 0.11377),
        ("20180212_211557_WPWS_20.V2A", "S16W", 0.00165),
        ("20180212_211557_WPWS_20.V2A", "S74E", 0.00509),
    ],
)
def test_peak_velocity_is_near_that_of_the_agency(file: str, component: str, velocity: float) -> None:
    # The agencies filter the velocity as well, and round the acceleration afterwards.
    assert peak_velocity(read_ground_motion(FOLDER / file, component)) == pytest.approx(velocity, rel=0.06)


@needs_records
def test_column_of_numbers_is_refused() -> None:
    assert refusal(FOLDER / "IELC180.acc").startswith("the file states no unit and no time step")


@pytest.mark.slow
@needs_records
def test_every_file_of_the_folder_is_read_or_refused_in_one_line() -> None:
    components, refused = 0, {}
    for path in record_files(FOLDER.parent):
        try:
            components += len(catalogue(path))
        except InputError as error:
            refused[path.relative_to(FOLDER.parent).as_posix()] = str(error)
    assert set(refused) == {"README.md", "INDEX.csv", "formats/INDEX.csv", "formats/IELC180.acc"}
    assert all(len(message.splitlines()) == 1 for message in refused.values())
    assert components == 57
