"""Reader of the matrices M, C and K of a building: CSV, NPZ or MAT."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bmd_rths_core.errors import InputError

FloatArray = NDArray[np.float64]

#: Largest file [bytes] and most floors; beyond them a model has to be condensed first.
MAX_BYTES, MAX_FLOORS = 10_000_000, 100

#: Matrices of a file, and whether each is required.
NAMES = {"M": True, "C": False, "K": True}


def read_matrices(path: str | Path) -> dict[str, FloatArray]:
    """Read the matrices of a building.

    NPZ and MAT (up to v7) have variables ``M``, ``K`` and, if it is known, ``C``. A CSV file has them one after the
    other, each below a line with its name alone; lines that begin with ``#`` are comments.

    Parameters
    ----------
    path : str or Path
        The file; its ending says what it is.

    Returns
    -------
    dict of str to ndarray, shape (n, n)
        ``M`` [kg], ``K`` [N/m] and, where there is one, ``C`` [N s/m].

    Raises
    ------
    InputError
        The file cannot be read, or the matrices do not belong together; the file is named.
    """
    path = Path(path)
    readers = {".csv": _read_csv, ".npz": _read_npz, ".mat": _read_mat}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: matrices are read from {', '.join(readers)}; the name of such a file is required")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES // 1_000_000} MB; condensed matrices are required")
        found = reader(path)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except Exception as error:  # whatever a broken archive makes of its reader
        raise InputError(f"{path}: cannot be read: {' '.join(str(error).split()) or type(error).__name__}") from error
    return {name: _checked(path, name, values) for name, values in _required(path, found).items()}


def _required(path: Path, found: Mapping[str, Any]) -> dict[str, Any]:
    for name, required in NAMES.items():
        if required and name not in found:
            raise InputError(f"{path}: no matrix {name}; it has {', '.join(sorted(found)) or 'none'}")
    return {name: found[name] for name in NAMES if name in found}


def _checked(path: Path, name: str, values: Any) -> FloatArray:
    matrix = np.asarray(values.toarray() if hasattr(values, "toarray") else values)
    if matrix.dtype.kind not in "fiu" or matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not matrix.size:
        raise InputError(f"{path}: {name} of shape {matrix.shape}; a square matrix of real numbers is required")
    if len(matrix) > MAX_FLOORS:
        raise InputError(f"{path}: {name} has {len(matrix)} rows; {MAX_FLOORS} are allowed; condense the model")
    if not np.isfinite(matrix).all():
        raise InputError(f"{path}: {name} has an entry that is not finite")
    return matrix.astype(float)


def _read_npz(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in NAMES if name in archive.files} | {
            name: None for name in archive.files if name not in NAMES
        }


def _read_mat(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat  # only who has such a file waits for it

    return {name: values for name, values in loadmat(path).items() if not name.startswith("__")}


def _read_csv(path: Path) -> dict[str, Any]:
    found: dict[str, list[list[float]]] = {}
    name = ""
    for number, line in enumerate(path.read_text(encoding="utf-8-sig").splitlines(), 1):
        cells = [cell.strip() for cell in line.replace(";", ",").rstrip(", ").split(",")]
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if len(cells) == 1 and cells[0] in NAMES:
            name = cells[0]
            if name in found:
                raise InputError(f"{path} line {number}: a second matrix {name}; one is required")
            found[name] = []
            continue
        if not name:
            raise InputError(f"{path} line {number}: {line.strip()[:60]!r}; the name M, C or K is required before it")
        try:
            found[name].append([float(cell) for cell in cells])
        except ValueError:
            problem = f"{line.strip()[:60]!r} is not a row of numbers with commas between"
            raise InputError(f"{path} line {number}: {problem}; a decimal point, no comma, is required") from None
    for name, rows in found.items():
        if any(len(row) != len(rows) for row in rows):
            lengths = sorted({len(row) for row in rows})
            raise InputError(f"{path}: {name} has {len(rows)} rows of {', '.join(map(str, lengths))} entries")
    return found
