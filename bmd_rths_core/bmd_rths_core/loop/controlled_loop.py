"""The loop of an interface control as one linear system: control and simulated table, closed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.compensators.protocol import LinearControl
from bmd_rths_core.config import Config
from bmd_rths_core.errors import InputError
from bmd_rths_core.integration.discretisation import DiscreteStateSpace
from bmd_rths_core.loop.build import make_force_correction, make_interface_control
from bmd_rths_core.loop.linear_loop import ClosedLoop, output_names, sensor_noise
from bmd_rths_core.stages.shear_estimator import estimator_state_space
from bmd_rths_core.table.models.simulated import SimulatedTable

FloatArray = NDArray[np.float64]


def controlled_loop(config: Config, mass_factor: float = 1.0, linear: LinearControl | None = None) -> ClosedLoop:
    """Assemble the loop of a configuration whose compensator owns the numerical substructure.

    Parameters
    ----------
    config : Config
        The whole configuration; limits do not matter here.
    mass_factor : float
        Masses of the real specimen over those that are known; stiffness and damping stay.
    linear : LinearControl, optional
        The control of this configuration, where it has been designed already.

    Returns
    -------
    ClosedLoop
        Every step measured, every command applied as asked for.

    Raises
    ------
    InputError
        The control refuses what is known, or is not linear.
    """
    specimen, step = config.specimen.building(), config.run.time_step
    control = make_interface_control(config) if linear is None else None
    if control is not None:
        linear = control.state_space()
        if linear is None and hasattr(control, "held"):
            linear = control.held()
    if linear is None:
        raise InputError(f"run.scheme: {config.run.scheme} is not linear; there are no matrices of its loop")
    own = linear.system
    real = specimen.with_factors(mass=mass_factor)
    table = SimulatedTable(config.simulated_table, real, step, config.run.seed).state_space(displacement=True)
    estimator = estimator_state_space(config.shear_estimator, specimen, step)
    correction = make_force_correction(config).state_space()
    sensors, floors = len(table.c), specimen.stories
    preview = own.b.shape[1] - sensors - 1
    if preview < 1 or own.d[1, preview] != 0.0:
        raise InputError(f"run.scheme: the force of {config.run.scheme} has to be known a step ahead")
    sizes = (len(own.a), sensors, len(table.a), preview, len(estimator.a))
    ends = np.cumsum(sizes).tolist()
    size = ends[-1]
    controlled, measured, moved, ahead, estimated = (slice(end - s, end) for end, s in zip(ends, sizes, strict=True))
    # A signal is a row: what it takes of the state of the loop and of the inputs.
    rows = np.eye(size + 1 + sensors)
    ground = np.vstack((rows[ahead], rows[size : size + 1]))
    inputs = np.vstack((ground, rows[measured]))
    demand = own.c @ rows[controlled] + own.d @ inputs
    command = demand[2:3]
    clean = table.c @ rows[moved] + table.d @ command
    noisy = clean + sensor_noise(config.simulated_table, floors)[:, None] * rows[size + 1 :]
    shear = estimator.c @ rows[estimated] + estimator.d @ noisy[: floors + 2]
    corrected = correction.d @ np.vstack((demand[1:2], shear))
    transition = np.vstack(
        (
            own.a @ rows[controlled] + own.b @ inputs,
            noisy,
            table.a @ rows[moved] + table.b @ command,
            ground[1:],
            estimator.a @ rows[estimated] + estimator.b @ noisy[: floors + 2],
        )
    )
    following = transition[controlled], np.vstack((ground[1:], np.zeros_like(ground[:1]), noisy))
    acting = own.c[1:2] @ following[0] + own.d[1:2] @ following[1]
    output = np.vstack((demand[:3], noisy, shear, corrected, acting, demand[3:]))
    start = np.zeros((size, max(1, preview)))
    start[controlled, 0] = linear.start
    start[ahead] = np.eye(preview, start.shape[1])
    return ClosedLoop(
        system=DiscreteStateSpace(transition[:, :size], transition[:, size:], output[:, :size], output[:, size:]),
        start=start,
        outputs=output_names(config, displacement=True),
        preview=preview,
        table=tuple(range(size)[moved]),
        integrators=linear.integrators,
    )
