"""Write a run of the vRTHS benchmark problem as a bag of standard messages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.record import software_versions
from bmd_rths_core.vrths.problem import RATE
from bmd_rths_core.vrths.study import FinishedPiece
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_writer import BagWriter
from bmd_rths_msgs_py.cdr import NANOSECONDS, ScalarCodec
from bmd_rths_msgs_py.topics import ACCELERATION_TYPE, FORCE_TYPE, NAMESPACE

POINT_TYPE = "geometry_msgs/msg/PointStamped"

#: Every eighth step is written, 512 a second: enough for every signal of it, in an eighth of the file.
EVERY = 8

_VECTORS_SIZE = 48


class PointCodec:
    """Three numbers in a PointStamped (``point.x``, ``.y``, ``.z``).

    Parameters
    ----------
    frame_id : str
        ``header.frame_id`` of the messages.
    """

    def __init__(self, frame_id: str = "") -> None:
        self._header, self._point = ScalarCodec(frame_id), Struct("<3d").pack

    def pack(self, stamp_ns: int, point: tuple[float, float, float]) -> bytes:
        """Return the message as bytes.

        Parameters
        ----------
        stamp_ns : int
            ``header.stamp`` [ns].
        point : tuple of float
            x, y and z.
        """
        return self._header.pack(stamp_ns, 0.0)[:-_VECTORS_SIZE] + self._point(*point)


def write_benchmark_run(finished: FinishedPiece, directory: Path) -> Path:
    """Write the nominal plant of a piece as a bag.

    ``ground_acceleration`` (AccelStamped, ``linear.x``), ``restoring_force`` (WrenchStamped, ``force.x``), and as
    PointStamped ``numerical_displacement`` and ``reference_displacement`` (x, y, z: floors 1 to 3) and
    ``actuator_displacement`` (x: commanded, y: measured), all below the namespace of a run [m/s², N, m].

    Parameters
    ----------
    finished : FinishedPiece
        The piece.
    directory : Path
        The bag directory, new or empty.

    Returns
    -------
    Path
        The directory.

    Raises
    ------
    InputError
        It cannot be written.
    """
    piece, run = finished.piece, finished.nominal
    actuator = np.column_stack((run.command, run.measured, np.zeros_like(run.command)))
    topics: list[tuple[str, str, Any, NDArray[np.float64]]] = [
        ("ground_acceleration", ACCELERATION_TYPE, ScalarCodec("world"), run.ground_acceleration),
        ("numerical_displacement", POINT_TYPE, PointCodec("ground"), run.displacement),
        ("actuator_displacement", POINT_TYPE, PointCodec("ground"), actuator),
        ("restoring_force", FORCE_TYPE, ScalarCodec("interface"), run.force),
        ("reference_displacement", POINT_TYPE, PointCodec("ground"), run.reference),
    ]
    about: Mapping[str, Any] = {
        "vrths": {"case": piece.case, "scheme": piece.scheme, "seed": piece.seed, **finished.runs[0]}
    }
    motion = {"name": piece.motion.name, "sha256": piece.motion.sha256, "source": piece.motion.source}
    writer = BagWriter(directory, metadata=start_metadata(about, motion, software_versions()))
    packed = [(f"{NAMESPACE}/{name}", kind, codec.pack, part[::EVERY].tolist()) for name, kind, codec, part in topics]
    for i in range(len(packed[0][3])):
        stamp = i * EVERY * NANOSECONDS // round(RATE)
        for name, kind, pack, values in packed:
            writer.write(name, kind, pack(stamp, values[i]), stamp, stamp)
    writer.close(end_metadata("finished", "end of the ground motion", None))
    return directory
