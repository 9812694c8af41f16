"""Write a MAT file of version 7.3: an HDF5 file with the head and the attributes that MATLAB looks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bmd_rths_core.export.channels import ExportedRun
from bmd_rths_core.export.files import structures

#: Text, then eight bytes of nothing, then version 2 and the order of the bytes.
_HEAD = b"MATLAB 7.3 MAT-file, written by bmd_rths".ljust(116) + bytes(8) + b"\x00\x02IM"

#: What stands before the HDF5 file [bytes].
_USER_BLOCK = 512


def to_mat73(runs: Sequence[ExportedRun], path: Path) -> None:
    """Write a MAT file of version 7.3, with the structures that version 7 has too.

    Parameters
    ----------
    runs : sequence of ExportedRun
        The runs.
    path : Path
        The file.
    """
    import h5py

    with h5py.File(path, "w", userblock_size=_USER_BLOCK) as file:
        _write(file, structures(runs))
    with open(path, "r+b") as head:
        head.write(_HEAD)


def _write(group: Any, content: Mapping[str, Any]) -> None:
    for name, value in content.items():
        if isinstance(value, Mapping):
            structure = group.create_group(name)
            structure.attrs["MATLAB_class"] = np.bytes_("struct")
            _write(structure, value)
        elif isinstance(value, str):
            _write_text(group, name, value)
        else:
            _write_numbers(group, name, np.asarray(value))


def _write_numbers(group: Any, name: str, values: np.ndarray[Any, Any]) -> None:
    """Write numbers as MATLAB has them: two dimensions, the columns first; integers of steps stay integers."""
    matrix = np.atleast_2d(values) if values.ndim < 2 else values.T  # a vector is a column
    if matrix.size:
        dataset = group.create_dataset(name, data=matrix, compression="gzip" if matrix.size > 1 else None)
    else:
        dataset = _empty(group, name, matrix.shape[::-1])
    dataset.attrs["MATLAB_class"] = np.bytes_("int64" if values.dtype.kind == "i" else "double")


def _write_text(group: Any, name: str, text: str) -> None:
    """Write text as a row of UTF-16 code units."""
    units = np.frombuffer(text.encode("utf-16-le", "replace"), np.uint16)
    dataset = group.create_dataset(name, data=units[:, None]) if len(units) else _empty(group, name, (0, 0))
    dataset.attrs["MATLAB_class"] = np.bytes_("char")
    dataset.attrs["MATLAB_int_decode"] = np.int32(2)


def _empty(group: Any, name: str, shape: tuple[int, ...]) -> Any:
    """Write what has no element: its shape stands in its place."""
    dataset = group.create_dataset(name, data=np.array(shape, np.uint64))
    dataset.attrs["MATLAB_empty"] = np.uint8(1)
    return dataset
