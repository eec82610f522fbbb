"""NumPy .npz, without pickled objects and only as large as declared sizes allow.

Source: NumPy, "NEP 1: A simple file format for NumPy arrays": a magic string, the version, the length of the
header, the header, the values.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from .._core import DataError
from ..errors import refuse, shown
from .gate import admit, one_by_one
from .member import Member, Refused, kind_of
from .source import Source

_FIX: Final = "save it again with numpy.savez(file, t=..., i_d=...)"
_OBJECTS: Final = "it holds Python objects, which may carry code"
_PREFIX_BYTES: Final = {(1, 0): 2, (2, 0): 4, (3, 0): 4}
# NumPy trusts no header that is longer.
_LONGEST_HEADER: Final = 10_000
# The best that deflate can do: 258 bytes by one bit for the length and one for the distance.
_DEFLATE: Final = 1032


class _Malformed(ValueError):
    """The file contradicts itself."""


def open_file(file: Path, max_bytes: int) -> Source:
    """The arrays of an .npz archive.

    Raises DataError on damage; reading raises it on objects and on more than `max_bytes` declared.
    """
    name = str(file)
    try:
        with zipfile.ZipFile(file) as archive:
            entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
            members = [_member(archive, entry) for entry in entries]
    except Exception as error:
        raise refuse(
            DataError, f"this .npz file cannot be read ({shown(str(error))})", file=name, fix=_FIX
        ) from error

    def load(index: int) -> NDArray[Any]:
        try:
            # The entry, not its name: an archive may hold a name twice.
            with zipfile.ZipFile(file) as archive, archive.open(entries[index]) as handle:
                return npy.read_array(handle, allow_pickle=False)
        except MemoryError:
            raise
        except Exception as error:
            raise Refused(
                f"it cannot be read ({shown(str(error))})", _FIX, column=members[index].name
            ) from error

    return admit(name, members, one_by_one(load), max_bytes)


def _member(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Member:
    """An array by its header. Raises _Malformed where it does not hold what it declares."""
    column = entry.filename.removesuffix(".npy")
    with archive.open(entry) as handle:
        shape, dtype = _header(handle, column)
    stored = dtype.itemsize * int(np.prod([int(n) for n in shape], dtype=object))
    longest = entry.compress_size * (1 if entry.compress_type == zipfile.ZIP_STORED else _DEFLATE)
    if dtype.hasobject:
        return Member(column, shape=shape, why=_OBJECTS, fix=_FIX)
    if entry.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) and entry.file_size > longest:
        raise _Malformed(f"'{shown(column)}' is cut short")
    return Member(column, kind=kind_of(dtype), shape=shape, memory=max(stored, entry.file_size))


def _header(handle: IO[bytes], column: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array; its header is read only where its length is plausible."""
    version = npy.read_magic(handle)
    prefix = handle.read(_PREFIX_BYTES.get(version, 0))
    length = int.from_bytes(prefix, "little")
    if not prefix or length > _LONGEST_HEADER:
        raise _Malformed(f"the header of '{shown(column)}' declares {length} bytes")
    text = io.BytesIO(prefix + handle.read(length))
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(text)
    return shape, dtype
