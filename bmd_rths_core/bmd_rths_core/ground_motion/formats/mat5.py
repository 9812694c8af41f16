"""Real arrays of a MATLAB file of version 5 to 7, read from its bytes.

`scipy.io.loadmat` ends the process on some damaged files and calls sound files with objects damaged. Here every length
and type is checked before it is used, and what is no real array is passed over. (MAT-File Format, The MathWorks, 2021.)
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
#: Types of numbers by their code in the file.
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
#: Classes of arrays of real numbers, and what the others are called.
_NUMERIC = {6: "double", 7: "single", 8: "int8", 9: "uint8", 10: "int16", 11: "uint16", 12: "int32", 13: "uint32",
            14: "int64", 15: "uint64"}  # fmt: skip
_OTHER = {1: "cell", 2: "structure", 3: "object", 4: "text", 5: "sparse", 16: "function", 17: "object", 18: "object"}
_COMPLEX = 0x08
#: Names inside a file by which MATLAB keeps the content of objects; nobody gave them.
_HIDDEN = ("", "__function_workspace__")


class DamagedMat(ValueError):
    """The bytes are no MATLAB file that can be read whole."""


@dataclass(frozen=True)
class Variable:
    """One variable.

    Parameters
    ----------
    name : str
        Its name.
    shape : tuple of int
        Its size.
    kind : str
        Class: ``"double"``, ``"single"``, ``"int16"``, …; ``"complex"`` for complex numbers; ``"object"`` and the like.
    values : ndarray or None
        The array, None for what is no array of real numbers.
    """

    name: str
    shape: tuple[int, ...]
    kind: str
    values: NDArray[np.float64] | None


def read_variables(content: bytes, limit: int) -> list[Variable]:
    """Return the variables of a file.

    Parameters
    ----------
    content : bytes
        The file.
    limit : int
        Most bytes a compressed variable may have.

    Returns
    -------
    list of Variable
        In the order of the file.

    Raises
    ------
    DamagedMat
        It is damaged, a name is there twice, or it is larger than `limit`.
    """
    if len(content) < _HEADER_BYTES:
        raise DamagedMat("shorter than its header")
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise DamagedMat("no mark of its byte order")
    variables = []
    for kind, body in _elements(content[_HEADER_BYTES:], order):
        if kind == _COMPRESSED:
            inner = list(_elements(_inflated(body, limit), order))
            if len(inner) != 1:
                raise DamagedMat(f"{len(inner)} variables in one that is compressed")
            kind, body = inner[0]
        if kind != _MATRIX:
            raise DamagedMat(f"an element of type {kind}, where a variable is required")
        variable = _variable(body, order)
        if variable.name not in _HIDDEN:
            variables.append(variable)
    names = [variable.name for variable in variables]
    if len(set(names)) < len(names):
        raise DamagedMat("a variable is there twice")
    return variables


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield type and bytes of each element."""
    place = 0
    while place < len(data):
        if place + 8 > len(data):
            raise DamagedMat("cut off in the head of an element")
        kind, length = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:  # up to four bytes stand in the head itself
            length, kind = kind >> 16, kind & 0xFFFF
            begin, behind = place + 4, place + 8
            if length > 4:
                raise DamagedMat(f"{length} bytes in a small element")
        else:
            begin = place + 8
            behind = begin + length if kind == _COMPRESSED else begin + -(-length // 8) * 8
        if begin + length > len(data):
            raise DamagedMat("cut off in an element")
        yield kind, data[begin : begin + length]
        place = behind


def _inflated(data: bytes, limit: int) -> bytes:
    decompressor = zlib.decompressobj()
    try:
        inflated = decompressor.decompress(data, limit)
    except zlib.error as error:
        raise DamagedMat(f"compressed data: {error}") from error
    if decompressor.unconsumed_tail or not decompressor.eof:
        raise DamagedMat("compressed data that are cut off or too large")
    return inflated


def _variable(body: bytes, order: str) -> Variable:
    parts = _elements(body, order)
    flags_kind, flags = next(parts, (0, b""))
    if flags_kind != 6 or len(flags) != 8:
        raise DamagedMat("a variable without flags")
    (word,) = struct.unpack_from(f"{order}I", flags)
    code, marks = word & 0xFF, word >> 8
    if code == 17:  # an object of a class written in MATLAB: name and class, but no size
        names = [data for kind, data in parts if kind == 1]
        return Variable(_name(names[0]) if names else "", (), "object", None)
    shape_kind, shape_data = next(parts, (0, b""))
    if shape_kind != 5 or len(shape_data) % 4 or len(shape_data) < 8:
        raise DamagedMat("a variable without a size")
    shape = struct.unpack(f"{order}{len(shape_data) // 4}i", shape_data)
    if any(count < 0 for count in shape):
        raise DamagedMat("a variable of negative size")
    name_kind, name_data = next(parts, (0, b""))
    if name_kind not in (1, 16):
        raise DamagedMat("a variable without a name")
    name = _name(name_data)
    if code not in _NUMERIC and code not in _OTHER:
        raise DamagedMat(f"variable {name!r} of class {code}")
    if code in _OTHER:
        return Variable(name, shape, _OTHER[code], None)
    if marks & _COMPLEX:
        return Variable(name, shape, "complex", None)
    kind, data = next(parts, (0, b""))
    dtype = np.dtype(order + _NUMBERS[kind]) if kind in _NUMBERS else None
    count = math.prod(shape)
    if dtype is None or len(data) != count * dtype.itemsize or next(parts, None) is not None:
        raise DamagedMat(f"variable {name!r} of another size than it says")
    values = np.frombuffer(data, dtype).astype(np.float64).reshape(shape, order="F")
    return Variable(name, shape, _NUMERIC[code], values)


def _name(data: bytes) -> str:
    return data.decode("ascii", "backslashreplace")
