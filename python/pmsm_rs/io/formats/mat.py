"""Numeric arrays of MATLAB .mat files of version 5 (-v6, -v7).

Read here rather than by scipy.io, whose compiled reader can crash the interpreter on a damaged file. Source:
MathWorks, "MAT-File Format", level 5: a header of 128 bytes, then elements of type, length and data. A
variable is an element that holds flags, dimensions, name, real part and, where complex, imaginary part.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..._core import DataError
from ...errors import refuse, shown
from .gate import admit, few_enough, one_by_one
from .matstruct import Array, Structure, columns
from .member import BOOLEAN, COMPLEX, NUMBER, TEXT, Member, Refused
from .source import Source

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
# Classes of arrays; others, such as handles of functions, have no size. The last ten are of numbers.
_CLASSES: Final = range(1, 16)
_NUMERIC: Final = range(6, 16)
_CHAR: Final = 4
_OTHER: Final = {1: "a cell array", 3: "an object", 5: "a sparse matrix"}
_STRUCTURE: Final = "it holds a structure"
_DEEPEST: Final = 16
_LETTERS: Final = {1: "ascii", 2: "latin-1", 16: "utf-8"}
_COMPLEX, _LOGICAL = 0x800, 0x200
# Of a packed variable this much is unpacked to find its size and its name, which has at most 63 characters.
_HEAD_BYTES: Final = 4096
# The best that deflate can do: 258 bytes by one bit for the length and one for the distance.
_DEFLATE: Final = 1032


class _Malformed(ValueError):
    """The file contradicts itself."""


@dataclass(frozen=True)
class _Variable:
    """A variable as the file declares it; `body` is its element, still packed where `packed`."""

    member: Member
    body: memoryview
    packed: bool
    size: int


def open_file(file: Path, max_bytes: int) -> Source:
    """The variables of a .mat file.

    Raises DataError on damage; reading raises it on more than `max_bytes` once unpacked.
    """
    name = str(file)
    try:
        data = file.read_bytes()
        order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
        if order is None:
            raise _Malformed("the byte-order mark is missing")
        variables = list(_variables(memoryview(data)[_HEADER_BYTES:], order, max_bytes))
        few_enough(len(variables))
    except Refused as refused:
        raise refuse(DataError, refused.problem, file=name, fix=refused.fix) from refused
    except (_Malformed, zlib.error, UnicodeDecodeError) as error:
        raise _damaged(error, name) from error

    def load(index: int) -> NDArray[Any]:
        try:
            return _values(variables[index], order)
        except (_Malformed, zlib.error) as error:
            raise _damaged(error, name) from error

    return admit(name, [variable.member for variable in variables], one_by_one(load), max_bytes)


def _damaged(error: Exception, file: str) -> DataError:
    return refuse(DataError, f"this .mat file cannot be read ({shown(str(error))})", file=file, fix=_FIX)


def _variables(data: memoryview, order: str, max_bytes: int) -> Iterator[_Variable]:
    nothing = memoryview(b"")
    for kind, body in _elements(data, order):
        packed = kind == _COMPRESSED
        content, size = body, len(body)
        if packed:
            plain = memoryview(zlib.decompressobj().decompress(body, _HEAD_BYTES))
            kind, size, start = _tag(plain, order)
            if size > _DEFLATE * len(body):
                raise _Malformed("a variable is cut short")
            content = plain[start:]
        if kind == _MATRIX:
            member = _member(content, size, order)
            if member is not None and member.why == _STRUCTURE and size <= max_bytes:
                whole = _unpacked(body, size) if packed else body
                for inner, own in columns(member.name, _structure(whole, order, 0)):
                    yield _Variable(inner, own or nothing, False, len(own or nothing))
            elif member is not None:
                yield _Variable(member, body, packed, size)


def _unpacked(body: memoryview, size: int) -> memoryview:
    """The content of a packed element of `size` bytes."""
    plain = memoryview(zlib.decompressobj().decompress(body, size + 8))
    if len(plain) < size + 8:
        raise _Malformed("a variable is cut short")
    return plain[8:]


def _structure(data: memoryview, order: str, depth: int) -> Structure:
    """The structure in an element: flags, size, name, length of the field names, these, and the fields."""
    parts = _elements(data, order)
    _, dims, _, length, names = (_part(parts) for _ in range(5))
    width = int(np.frombuffer(length[1][:4], order + "i4")[0]) if len(length[1]) >= 4 else 0
    count = math.prod(int(n) for n in np.frombuffer(dims[1], order + "i4"))
    if width < 1 or depth > _DEEPEST or len(names[1]) % width:
        raise _Malformed("the fields of a structure cannot be read")
    text = bytes(names[1])
    fields = [text[at : at + width].split(b"\0")[0].decode("ascii") for at in range(0, len(text), width)]
    if not fields:
        return Structure(())
    elements = []
    for _ in range(count):
        elements.append({field: _field(_part(parts)[1], order, depth) for field in fields})
    return Structure(tuple(elements))


def _field(data: memoryview, order: str, depth: int) -> Structure | str | Array:
    """The value of a field; what has no numbers, as an array that says so."""
    # An empty array may have no content at all.
    member = _member(data, len(data), order, "field") if data else None
    if member is None:
        return ""
    if member.why == _STRUCTURE:
        return _structure(data, order, depth + 1)
    if member.kind == TEXT:
        parts = _elements(data, order)
        for _ in range(3):
            _part(parts)
        kind, letters = _part(parts)
        return bytes(letters).decode(
            _LETTERS.get(kind, {"<": "utf-16-le", ">": "utf-16-be"}[order]), "replace"
        )
    return Array(member, data, lambda: _values(_Variable(member, data, False, len(data)), order))


def _tag(data: memoryview, order: str) -> tuple[int, int, int]:
    """Type and size of the element at the start of `data`, and where its content starts."""
    if len(data) < 8:
        raise _Malformed("the file ends early")
    kind, size = (int(word) for word in np.frombuffer(data[:8], order + "u4"))
    if not kind >> 16:
        return kind, size, 8
    # Short elements keep both in one word of eight bytes.
    if kind >> 16 > 4:
        raise _Malformed("a short element is too long")
    return kind & 0xFFFF, kind >> 16, 4


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of each element."""
    at = 0
    while at + 8 <= len(data):
        kind, size, start = _tag(data[at:], order)
        end = at + start + size
        if end > len(data):
            raise _Malformed("the file ends early")
        yield kind, data[at + start : end]
        at = at + 8 if start == 4 else end if kind == _COMPRESSED else end + -size % 8


def _member(data: memoryview, size: int, order: str, field: str = "") -> Member | None:
    """What the first elements of a variable of `size` bytes declare, None where it has no name and is no
    `field`.
    """
    parts = _elements(data, order)
    flags, dims, name = (_part(parts) for _ in range(3))
    word = int(np.frombuffer(flags[1][:4], order + "u4")[0]) if len(flags[1]) >= 4 else 0
    text = bytes(name[1]).decode("ascii") or field
    number = word & 0xFF
    if not text or number not in _CLASSES:
        return None
    if len(dims[1]) % 4 or dims[0] != 5:
        raise _Malformed(f"the size of {text} cannot be read")
    shape = tuple(int(n) for n in np.frombuffer(dims[1], order + "i4"))
    if min(shape, default=-1) < 0:
        raise _Malformed(f"{text} does not have the size it declares")
    if number == _CHAR:
        # MATLAB keeps a string as a row of characters.
        return Member(text, kind=TEXT, shape=shape[:1])
    if number not in _NUMERIC:
        return Member(text, shape=shape, why=_STRUCTURE if number == 2 else f"it holds {_OTHER[number]}")
    kind = COMPLEX if word & _COMPLEX else BOOLEAN if word & _LOGICAL else NUMBER
    return Member(text, kind=kind, shape=shape, memory=size)


def _values(variable: _Variable, order: str) -> NDArray[Any]:
    """The values of a numeric variable. Raises _Malformed where they are not what was declared."""
    content = variable.body
    if variable.packed:
        content = _unpacked(variable.body, variable.size)
    shape = variable.member.shape or ()
    parts = _elements(content, order)
    for _ in range(3):
        _part(parts)
    real = _numbers(_part(parts), variable.member, order)
    if variable.member.kind == COMPLEX:
        both = np.empty(real.size, dtype=np.complex128)
        both.real, both.imag = real, _numbers(_part(parts), variable.member, order)
        real = both
    return real.reshape(shape, order="F")


def _numbers(part: tuple[int, memoryview], member: Member, order: str) -> NDArray[Any]:
    kind, values = part
    stored = _TYPES.get(kind)
    if stored is None or len(values) % int(stored[1]):
        raise _Malformed(f"the values of {member.name} cannot be read")
    array: NDArray[Any] = np.frombuffer(values, order + stored)
    if math.prod(member.shape or ()) != array.size:
        raise _Malformed(f"{member.name} does not have the size it declares")
    return array


def _part(parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    part = next(parts, None)
    if part is None:
        raise _Malformed("a variable is cut short")
    return part
