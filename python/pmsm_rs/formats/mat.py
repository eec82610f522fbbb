"""Numeric arrays of MATLAB .mat files of version 5 (-v6, -v7).

Read here rather than by scipy.io, whose compiled reader can crash the interpreter on a damaged file. Source:
MathWorks, "MAT-File Format", level 5: a header of 128 bytes, then elements of type, length and data.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import refuse
from .source import Source, from_arrays

_FIX: Final = "save it again from MATLAB with save(..., '-v7')"
_HEADER_BYTES: Final = 128
_MATRIX, _COMPRESSED = 14, 15
_TYPES: Final = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
# Classes of full numeric arrays: double, single and the integers.
_NUMERIC: Final = range(6, 16)
_COMPLEX: Final = 0x800


class _Malformed(ValueError):
    """The file contradicts itself."""


class _TooLarge(ValueError):
    """More bytes than allowed."""


def open_file(file: Path, max_bytes: int) -> Source:
    """The numeric arrays of a .mat file.

    Raises DataError on damage and on more than `max_bytes` once unpacked.
    """
    name = str(file)
    try:
        arrays = dict(_arrays(file.read_bytes(), max_bytes))
    except _TooLarge:
        raise refuse(
            DataError,
            f"it unpacks to more than the {max_bytes} bytes allowed",
            file=name,
            fix="cut the recording, or raise max_bytes",
        ) from None
    except (_Malformed, zlib.error, UnicodeDecodeError) as error:
        raise refuse(DataError, f"this .mat file cannot be read ({error})", file=name, fix=_FIX) from error
    if not arrays:
        raise refuse(
            DataError, "it holds no numeric arrays", file=name, fix="save the columns as plain vectors"
        )
    return from_arrays(name, arrays)


def _arrays(data: bytes, max_bytes: int) -> Iterator[tuple[str, NDArray[np.generic]]]:
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise _Malformed("the byte-order mark is missing")
    left = max_bytes
    for kind, body in _elements(memoryview(data)[_HEADER_BYTES:], order):
        content = body
        if kind == _COMPRESSED:
            inflate = zlib.decompressobj()
            plain = inflate.decompress(body, left + 1)
            left -= len(plain)
            if left < 0:
                raise _TooLarge
            if not inflate.eof:
                raise _Malformed("a variable is cut short")
            kind, content = next(_elements(memoryview(plain), order), (0, memoryview(b"")))
        if kind == _MATRIX:
            found = _matrix(content, order)
            if found is not None:
                left -= found[1].nbytes if content is body else 0
                if left < 0:
                    raise _TooLarge
                yield found


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and data of each element; short ones keep both in one word of eight bytes."""
    at = 0
    while at + 8 <= len(data):
        kind, size = (int(word) for word in np.frombuffer(data[at : at + 8], order + "u4"))
        if kind >> 16:
            kind, size = kind & 0xFFFF, kind >> 16
            start, end, padded = at + 4, at + 4 + size, at + 8
            if size > 4:
                raise _Malformed("a short element is too long")
        else:
            start, end = at + 8, at + 8 + size
            padded = end if kind == _COMPRESSED else end + -size % 8
        if end > len(data):
            raise _Malformed("the file ends early")
        yield kind, data[start:end]
        at = padded


def _matrix(data: memoryview, order: str) -> tuple[str, NDArray[np.generic]] | None:
    """Name and values of an array, None where it is no full numeric array or has no name."""
    parts = _elements(data, order)
    flags, dims, name = (_part(parts) for _ in range(3))
    word = int(np.frombuffer(flags[1][:4], order + "u4")[0]) if len(flags[1]) >= 4 else 0
    text = bytes(name[1]).decode("ascii")
    if (word & 0xFF) not in _NUMERIC or not text:
        return None
    if len(dims[1]) % 4 or dims[0] != 5:
        raise _Malformed(f"the size of {text} cannot be read")
    shape = tuple(int(n) for n in np.frombuffer(dims[1], order + "i4"))
    kind, values = _part(parts)
    stored = _TYPES.get(kind)
    if stored is None or len(values) % int(stored[1]):
        raise _Malformed(f"the values of {text} cannot be read")
    array: NDArray[np.generic] = np.frombuffer(values, order + stored)
    if min(shape, default=-1) < 0 or math.prod(shape) != array.size:
        raise _Malformed(f"{text} does not have the size it declares")
    if word & _COMPLEX:
        array = array.astype(np.complex128)
    return text, array.reshape(shape, order="F")


def _part(parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    part = next(parts, None)
    if part is None:
        raise _Malformed("a variable is cut short")
    return part
