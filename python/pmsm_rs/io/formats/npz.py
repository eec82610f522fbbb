"""NumPy .npz, without pickled objects and only as large as declared sizes allow.

Source: NumPy, "NEP 1: A simple file format for NumPy arrays": a magic string, the version, the length of the
header, the header, the values.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from ..._core import DataError
from ...errors import refuse, shown
from .gate import admit, few_enough, one_by_one
from .member import Member, Refused, Wanted, kind_of
from .source import Source

_FIX: Final = "save it again with numpy.savez(file, t=..., i_d=...)"
_OBJECTS: Final = "it holds Python objects, which may carry code"
_PREFIX_BYTES: Final = {(1, 0): 2, (2, 0): 4, (3, 0): 4}
# NumPy trusts no header that is longer.
_LONGEST_HEADER: Final = 10_000
# The best that deflate can do: 258 bytes by one bit for the length and one for the distance.
_DEFLATE: Final = 1032
# The end of an archive: its record, a comment, and the two records of ZIP64.
_LONGEST_END: Final = 22 + (1 << 16) + 20 + 56
# Room for all the columns that a file may have, with names longer than usual.
_LARGEST_DIRECTORY: Final = 16 << 20


class _Malformed(ValueError):
    """The file contradicts itself."""


def _check_directory(file: Path) -> None:
    """Raises _Malformed where the directory of the archive is far too large.

    Each of its entries, of 46 bytes and more, takes Python some twenty times as much. Source: PKWARE,
    "APPNOTE.TXT", 4.3.14 to 4.3.16: the end record and, for archives beyond 4 GB, that of ZIP64.
    """
    with file.open("rb") as handle:
        size = handle.seek(0, 2)
        handle.seek(max(0, size - _LONGEST_END))
        tail = handle.read()
    at = tail.rfind(b"PK\5\6")
    wide = tail.rfind(b"PK\6\6", 0, max(at, 0))
    stated = [tail[at + 12 : at + 16]] if at >= 0 else []
    if wide >= 0:
        stated.append(tail[wide + 40 : wide + 48])
    declared = [int.from_bytes(text, "little") for text in stated]
    # All ones mean that the record of ZIP64 says it.
    if any(n > _LARGEST_DIRECTORY for n in declared if not (wide >= 0 and n == 0xFFFFFFFF)):
        raise _Malformed(f"its directory declares {max(declared)} bytes")


def open_file(file: Path, max_bytes: int) -> Source:
    """The arrays of an .npz archive.

    Raises DataError on damage; reading raises it on objects and on more than `max_bytes` declared.
    """
    name = str(file)
    try:
        _check_directory(file)
        with zipfile.ZipFile(file) as archive:
            entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
            few_enough(len(entries))
            members = [_member(archive, entry) for entry in entries]
    except Refused as refused:
        raise refuse(DataError, refused.problem, file=name, fix=refused.fix) from refused
    except MemoryError:
        raise
    except Exception as error:
        raise refuse(
            DataError, f"this .npz file cannot be read ({shown(str(error))})", file=name, fix=_FIX
        ) from error

    def fetch(wanted: list[Wanted]) -> Sequence[NDArray[np.float64]]:
        # Opened once for all of them, as that reads the whole directory of the archive.
        with zipfile.ZipFile(file) as archive:
            return one_by_one(lambda index: _load(archive, entries[index], members[index].name))(wanted)

    return admit(name, members, fetch, max_bytes)


def _load(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, column: str) -> NDArray[Any]:
    """The values of an array. Raises Refused where they are damaged."""
    try:
        # The entry, not its name: an archive may hold a name twice.
        with archive.open(entry) as handle:
            values: NDArray[Any] = npy.read_array(handle, allow_pickle=False)
            return values
    except MemoryError:
        raise
    except Exception as error:
        raise Refused(f"it cannot be read ({shown(str(error))})", _FIX, column=column) from error


def _member(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Member:
    """An array by its header. Raises _Malformed where it does not hold what it declares."""
    column = entry.filename.removesuffix(".npy")
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        # Python unpacks others, which NumPy does not write, without a limit on what comes out at once.
        return Member(column, why="it is packed in another way than NumPy packs", fix=_FIX)
    with archive.open(entry) as handle:
        shape, dtype = _header(handle, column)
    stored = dtype.itemsize * int(np.prod([int(n) for n in shape], dtype=object))
    longest = entry.compress_size * (1 if entry.compress_type == zipfile.ZIP_STORED else _DEFLATE)
    if dtype.hasobject:
        return Member(column, shape=shape, why=_OBJECTS, fix=_FIX)
    if entry.file_size > longest:
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
