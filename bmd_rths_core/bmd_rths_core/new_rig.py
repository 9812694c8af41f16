"""The configuration of a rig of one's own, written with comments for whoever reads it next."""

from __future__ import annotations

from dataclasses import dataclass

from bmd_rths_core.errors import InputError


@dataclass(frozen=True)
class Structure:
    """A substructure as a person tells it: stories with one modal damping ratio, or a file of matrices.

    Parameters
    ----------
    masses, stiffnesses : tuple of float
        From the bottom to the top [kg, N/m]; empty with `matrices`.
    damping_ratios : tuple of float
        One for all modes, or one a mode; empty where the file of matrices has C.
    matrices : str
        Path of a file; empty for stories.
    """

    masses: tuple[float, ...] = ()
    stiffnesses: tuple[float, ...] = ()
    damping_ratios: tuple[float, ...] = ()
    matrices: str = ""

    def lines(self) -> list[str]:
        """Return the parameters as lines of YAML, without indent."""
        if self.matrices:
            lines = [f"matrices: {quoted(self.matrices)}  # M, K and, if it is known, C, from the bottom to the top"]
        else:
            lines = [
                f"masses: {_listed(self.masses)}  # kg",
                f"stiffnesses: {_listed(self.stiffnesses)}  # N/m",
            ]
        if self.damping_ratios:
            lines += ["damping: modal", f"damping_ratios: {_listed(self.damping_ratios)}  # 0.02 is 2 %"]
        return lines


@dataclass(frozen=True)
class Rig:
    """A rig as a person tells it.

    Parameters
    ----------
    name : str
        For the heading.
    numerical, specimen : Structure
        Below and above the interface.
    stroke, velocity, acceleration, force, platen_mass : float
        Capacity of the table [m, m/s, m/s², N, kg]; 0 for what is not known.
    frequency_response : str
        File of the measured table; empty for a servo that the specimen pulls at.
    rate : float
        Steps a second [Hz].
    motion : str
        Path of a record, or the name of a shipped one.
    peak_acceleration : float
        It is scaled to [m/s²]; 0 for the record as it is.
    time_scale : float
        Factor on its time axis.
    scheme : str
        Compensator.
    lead_time : float, optional
        Of the phase lead [s].
    load_cells : bool
        The shear comes from load cells, not from accelerometers.
    feedback_scale : float
        Share of the shear that is fed back.
    """

    name: str
    numerical: Structure
    specimen: Structure
    stroke: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    force: float = 0.0
    platen_mass: float = 0.0
    frequency_response: str = ""
    rate: float = 200.0
    motion: str = "el_centro_1940_ns"
    peak_acceleration: float = 0.0
    time_scale: float = 1.0
    scheme: str = "plc_fc"
    lead_time: float | None = None
    load_cells: bool = False
    feedback_scale: float = 1.0

    @property
    def time_step(self) -> float:
        """Δt [s]."""
        if not 10.0 <= self.rate <= 10_000.0:
            raise InputError(f"rate: {self.rate:g} Hz is not allowed; >= 10 Hz and <= 10000 Hz is required")
        return 1.0 / self.rate


def rig_text(rig: Rig) -> str:
    """Return the configuration of a rig, with comments.

    Parameters
    ----------
    rig : Rig
        The rig.

    Returns
    -------
    str
        YAML that `load_config` and ROS read.
    """
    capacity = [
        f"{key}: {_number(value)}  # {unit}"
        for key, value, unit in (
            ("stroke", rig.stroke, "m, to either side"),
            ("velocity", rig.velocity, "m/s"),
            ("acceleration", rig.acceleration, "m/s2, with the specimen on the table"),
            ("force", rig.force, "N"),
            ("platen_mass", rig.platen_mass, "kg, platen and piston"),
        )
        if value
    ]
    table = (
        ["dynamics: measured", f"frequency_response: {quoted(rig.frequency_response)}  # fitted when it is read"]
        if rig.frequency_response
        else ["dynamics: interacting_servo  # assumed, until `bmd-rths identify` has measured the table"]
    )
    lead = [] if rig.lead_time is None else [f"lead_time: {_number(rig.lead_time)}  # s, delay of the table model"]
    blocks = (
        ("run", "", [f"time_step: {_number(rig.time_step)}  # s, {rig.rate:g} Hz", f"scheme: {rig.scheme}"]),
        ("rig", "capacity of the table; limits, interlocks and the emulated actuator follow from it", capacity),
        (
            "ground_motion",
            "",
            [
                f"record: {quoted(rig.motion)}",
                f"peak_acceleration: {_number(rig.peak_acceleration)}  # m/s2 it is scaled to; 0 as it is",
                f"time_scale: {_number(rig.time_scale)}",
            ],
        ),
        ("numerical_substructure", "stories from the ground up; the last is the interface", rig.numerical.lines()),
        ("specimen", "stories from the table up", rig.specimen.lines()),
        ("command_shaper", "", lead),
        ("table", "", ["controller: simulated  # udp for a real one, or bmd-rths run --table udp://HOST:PORT"]),
        ("simulated_table", "", table),
        ("shear_estimator", "", [f"source: {'load_cell' if rig.load_cells else 'kalman'}"]),
        ("force_correction", "", [f"feedback_scale: {_number(rig.feedback_scale)}  # share of the shear fed back"]),
    )
    lines = [
        f"# {rig.name}. Written by bmd-rths new-rig; every parameter that is not here has its default, and",
        "# docs/reference/parameters.md explains them all. SI units: kg, N, m, s.",
        "/**:",
        "  ros__parameters:",
    ]
    for name, remark, entries in blocks:
        if entries:
            lines += [f"    {name}:{f'  # {remark}' if remark else ''}", *(f"      {entry}" for entry in entries)]
    return "\n".join(lines) + "\n"


def quoted(text: str) -> str:
    """Return text as a YAML string in single quotes.

    Parameters
    ----------
    text : str
        A path, say.
    """
    return "'" + text.replace("'", "''") + "'"


def _listed(values: tuple[float, ...]) -> str:
    return f"[{', '.join(map(_number, values))}]"


def _number(value: float) -> str:
    """Return a number that YAML and ROS both read as one with a decimal point."""
    text = f"{float(value):.12g}"
    if "e" in text and "." not in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa}.0e{exponent}"
    return text if any(mark in text for mark in ".e") else f"{text}.0"
