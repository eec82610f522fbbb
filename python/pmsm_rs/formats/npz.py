"""NumPy .npz, without pickled objects and only as large as declared sizes allow."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from .._core import DataError
from ..errors import refuse
from .source import Source, from_arrays

_FIX = "save it again with numpy.savez(file, t=..., i_d=...)"


class _Lazy(Mapping[str, object]):
    """Arrays of an archive, read when asked for."""

    def __init__(self, file: Path, members: tuple[str, ...]) -> None:
        self.file, self.members = file, members

    def __getitem__(self, name: str) -> object:
        if name not in self.members:
            raise KeyError(name)
        try:
            with zipfile.ZipFile(self.file) as archive, archive.open(f"{name}.npy") as handle:
                return npy.read_array(handle, allow_pickle=False)
        except Exception as error:
            raise refuse(
                DataError, f"it cannot be read ({error})", file=str(self.file), column=name, fix=_FIX
            ) from error

    def __iter__(self) -> Iterator[str]:
        return iter(self.members)

    def __len__(self) -> int:
        return len(self.members)


def open_file(file: Path, max_bytes: int) -> Source:
    """The arrays of an .npz archive.

    Raises DataError on objects, damage, and more than `max_bytes` declared.
    """
    name = str(file)
    shapes: dict[str, tuple[int, ...]] = {}
    total = 0
    try:
        with zipfile.ZipFile(file) as archive:
            for member in archive.infolist():
                if not member.filename.endswith(".npy"):
                    continue
                column = member.filename.removesuffix(".npy")
                with archive.open(member) as handle:
                    version = npy.read_magic(handle)
                    reader = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
                    shape, _, dtype = reader(handle)
                if dtype.hasobject:
                    raise refuse(
                        DataError,
                        "it holds Python objects, which may carry code",
                        file=name,
                        column=column,
                        fix=_FIX,
                    )
                total += max(
                    dtype.itemsize * int(np.prod([int(n) for n in shape], dtype=object)), member.file_size
                )
                shapes[column] = shape
    except DataError:
        raise
    except Exception as error:
        raise refuse(DataError, f"this .npz file cannot be read ({error})", file=name, fix=_FIX) from error
    if total > max_bytes:
        raise refuse(
            DataError,
            f"it unpacks to {total} bytes, more than the {max_bytes} allowed",
            file=name,
            fix="cut the recording, or raise max_bytes",
        )
    if not shapes:
        raise refuse(DataError, "it holds no arrays", file=name, fix=_FIX)
    return from_arrays(name, _Lazy(file, tuple(shapes)), shapes)
