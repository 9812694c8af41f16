"""Small records in every format, written as the documentation of each format says, with made-up values."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.io

#: Three components of 24 points in cm/s², of mean zero and with one decimal, so that every format can hold them.
TIME = np.arange(24)
COMPONENTS = tuple(np.round(100.0 * (1 + i) * np.sin(2 * np.pi * (1 + i) * TIME / 24), 1) for i in range(3))
TIME_STEP = 0.02


@dataclass(frozen=True)
class Sample:
    """A file and what is in it."""

    content: bytes
    names: tuple[str, ...]
    unit: str = "from_file"
    needs_component: bool = True


def fortran(values: Sequence[float], columns: int, form: str) -> str:
    cells = [format(value, form) for value in values]
    return "".join("".join(cells[i : i + columns]) + "\n" for i in range(0, len(cells), columns))


def knet() -> bytes:
    counts = COMPONENTS[0] * 10 + 5000  # an offset, as the sensors have
    header = [
        "Origin Time       2020/01/01 00:00:00",
        "Station Code      XXX001",
        "Sampling Freq(Hz) 50Hz",
        "Duration Time(s)  0.48",
        "Dir.              N-S",
        "Scale Factor      2000(gal)/20000",
        "Max. Acc. (gal)   100.0",
        "Memo.             ",
    ]
    return ("\n".join(header) + "\n" + fortran(counts, 8, "9.0f")).encode()


def cosmos(quantity: str = "acceleration") -> bytes:
    text = ""
    for channel, values in zip(("HNN", "HNE", "HNZ"), COMPONENTS, strict=True):
        real = [-999.0] * 100
        real[33], real[61] = 0.01, 1000 * TIME_STEP  # the recorder's step in s, that of the values in ms
        text += f"Corrected {quantity}    (Format v01.20 with 13 text lines)\n" + "A made-up record\n" * 12
        text += " 100 Integer-header values follow on  10 lines, Format= (10I8)\n" + fortran([-999] * 100, 10, "8d")
        text += " 100 Real-header values follow on  20 lines, Format= (5F15.6)\n" + fortran(real, 5, "15.6f")
        text += f'   1 Comment line(s) follow, each starting with a "|":\n|<SCNL>XXX.{channel}.YY.--   <AUTH>\n'
        text += f"      24 {quantity} pts, approx    0 secs, units=cm/sec2(04),Format=(8F10.3)\n"
        text += fortran(values, 8, "10.3f") + f"End-of-data for Chan{channel} acceleration\n"
    return text.encode()


def csmip(directions: Sequence[str] = ("90 DEG", "UP", "0 DEG")) -> bytes:
    text = ""
    for number, (direction, values) in enumerate(zip(directions, COMPONENTS, strict=True), 1):
        text += f"CORRECTED ACCELEROGRAM   XXX-1       CHAN  {number}: {direction:>6}     FROM\nA MADE-UP RECORD\n"
        text += f"XXX-1      SOMEWHERE   CHAN  {number}: {direction:>6}\n" + fortran([0] * 100, 16, "5d")
        for quantity, unit in (("ACCEL", "CM/SEC/SEC"), ("VELOC", "CM/SEC"), ("DISPL", "CM")):
            text += f"   24 POINTS OF {quantity} DATA EQUALLY SPACED AT  .020 SEC.  (UNITS: {unit})\n"
            text += fortran(values if quantity == "ACCEL" else 7.0 * TIME, 8, "10.3f")
        text += f"/&  ----------  END OF DATA FOR CHANNEL  {number}  ----------\n"
    return text.encode()


def geonet() -> bytes:
    text = ""
    for name, values in zip(("N10E", "S80E", "Up"), COMPONENTS, strict=True):
        integers, reals = np.zeros((4, 10), dtype=int), np.zeros((6, 10))
        integers[3, 3:6] = 24
        reals[2, 5] = TIME_STEP
        text += "Corrected accelerogram XXX GNS Science\n" + "a made-up record\n" * 11
        text += f"Component {name:5} Longitudinal Accelerometer Axis\n"
        text += "Acceleration:  peak    999.9 mm/s/s at   1.00 sec     rms      1.0 mm/s/s\n"
        text += "Velocity:      peak    99.9 mm/s\nDisplacement:  peak    9.9 mm\n"
        text += fortran(integers.ravel(), 10, "8d") + fortran(reals.ravel(), 10, "8.3f")
        text += fortran(10 * values, 10, "8.1f") + 2 * fortran(TIME, 10, "8.2f")
    return text.encode()


def esm() -> bytes:
    header = [
        "EVENT_NAME: SOMEWHERE",
        "EVENT_ID: XX-0000-0001",
        "HYPOCENTER_REFERENCE: ",
        "SAMPLING_INTERVAL_S: 0.020000",
        "NDATA: 24",
        "STREAM: HNE",
        "UNITS: cm/s^2",
        "INSTRUMENT_ANALOG/DIGITAL: D",
        "PGA_CM/S^2: 100.0",
        "HEADER_FORMAT: DYNA 1.2",
        "DATA_TYPE: ACCELERATION",
    ]
    return ("\n".join(header) + "\n" + fortran(COMPONENTS[0], 1, ".6f")).encode()


def cwa() -> bytes:
    header = [
        "#Earthquake Information",
        "#Origin Time(GMT+08): 2020/01/01-00:00:00",
        "",
        "#Station Information",
        "#RecordLength(sec): 0.48",
        "#SampleRate(Hz): 50",
        "#AmplitudeUnit:  gal. DCoffset(corr)",
        "#DataSequence: Time U(+); N(+); E(+)",
        "#Data: 4F10.3 ",
    ]
    rows = np.column_stack([TIME * TIME_STEP, *COMPONENTS])
    return ("\r\n".join(header) + "\r\n" + fortran(rows.ravel(), 4, "10.3f").replace("\n", "\r\n")).encode()


def jma() -> bytes:
    header = " SITE CODE= 123松橋 ,1,2\n LAT.=   32.0\n SAMPLING RATE= 50Hz\n UNIT  = gal(cm/s/s)\n NS,EW,UD\n"
    rows = "".join(",".join(f"{value:.3f}" for value in row) + "\n" for row in np.column_stack(COMPONENTS))
    return header.encode("shift_jis") + rows.encode()


def simcenter() -> bytes:
    data = {f"data_{axis}": list(values) for axis, values in zip("xyz", COMPONENTS, strict=True)}
    return json.dumps({"PGA_x": 1.0, "dT": TIME_STEP, "name": "made up", **data}, indent=1).encode()


def mat(**variables: object) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, variables, do_compression=True)
    return stream.getvalue()


def mat_of_two() -> bytes:
    first, second = (np.vstack([TIME * TIME_STEP, values]) for values in COMPONENTS[:2])
    return mat(first=first, second=second.T.astype(np.float32), gain=2.0, text="made up")


SAMPLES = {
    "K-NET": Sample(knet(), ("N-S",), needs_component=False),
    "COSMOS V2": Sample(cosmos(), ("HNN", "HNE", "HNZ")),
    "CSMIP V2": Sample(csmip(), ("90 DEG", "UP", "0 DEG")),
    "GeoNet V2A": Sample(geonet(), ("N10E", "S80E", "Up")),
    "ESM": Sample(esm(), ("HNE",), needs_component=False),
    "CWA": Sample(cwa(), ("U", "N", "E")),
    "JMA CSV": Sample(jma(), ("NS", "EW", "UD")),
    "SimCenter JSON": Sample(simcenter(), ("x", "y", "z"), unit="cm/s2"),
    "MAT": Sample(mat_of_two(), ("first", "second"), unit="cm/s2"),
}
