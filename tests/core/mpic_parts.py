"""A small hybrid test whose control knows the truth, for tests of the model-predictive interface control."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from bmd_rths_core.compensators.mpic.estimation import ModelError
from bmd_rths_core.compensators.mpic.tracking import TrackingWeights
from bmd_rths_core.compensators.mpic.virtual_building import virtual_building
from bmd_rths_core.compensators.protocol import SensorNoise
from bmd_rths_core.config import Config
from bmd_rths_core.ground_motion.motion import GroundMotion
from bmd_rths_core.structure.shear_building import ShearBuilding
from bmd_rths_core.table.models.held_plant import held_plant
from bmd_rths_core.table.models.plant import interacting_plant

DT = 0.005
NUMERICAL = ShearBuilding((900.0, 700.0), (3e6, 2.5e6), (4e3, 3e3))
SPECIMEN = ShearBuilding((760.0, 800.0), (2.5e6, 4.9e6), (3330.0, 78.0))
NOISE = SensorNoise(0.0524, 5e-5, 20.0)
ERROR = ModelError(command=0.01, floors=0.2)
WEIGHTS = TrackingWeights(floors=0.03, command=1e-3, centring=1.5)


def exact(**changes):
    """Return a configuration whose identified model is the truth of its simulated table."""
    table = Config().simulated_table
    servo = {name: getattr(table, f"{name}") for name in ("servo_real_pole", "servo_frequency", "servo_damping_ratio")}
    known = {"table": "interacting_servo", "platen_mass": table.platen_mass, **servo}
    values = {f"identified_model__{name}": value for name, value in known.items()}
    return Config().changed(run__scheme="mpic", shear_estimator__source="load_cell", **(values | changes))


def quiet(**changes):
    noises = ("acceleration_noise", "shear_noise", "displacement_noise", "force_noise")
    return exact(**{f"simulated_table__{name}": 0.0 for name in noises}, **changes)


def motion(steps=600, seed=3):
    """Return noise of 1 to 10 Hz: the ground comes back."""
    band = butter(2, (1.0, 10.0), "bandpass", fs=1.0 / DT, output="sos")
    smooth = sosfiltfilt(band, np.random.default_rng(seed).standard_normal(steps))
    ramp = np.minimum(1.0, np.arange(steps) / 100.0) * np.minimum(1.0, np.arange(steps)[::-1] / 100.0)
    return GroundMotion("random", DT, 0.3 * smooth * ramp / np.abs(smooth).max(), "made here", "0" * 64)


def parts(delay=0.0):
    plant = held_plant(interacting_plant(43.0, 135.0, 0.05, 6353.0, SPECIMEN), delay, DT)
    return plant, virtual_building(NUMERICAL, SPECIMEN, 1.0, DT)
