"""HDF5 and MATLAB v7.3 by h5py.

Links and storage that lead out of the file are never followed: an HDF5 file may name any other file as the
place of its data. MATLAB stores matrices transposed and complex numbers as pairs.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..selection import Selection
from . import Description, Parts, Refused, describe, numbers, too_large

_MOST_OBJECTS: Final = 20_000
_DEEPEST: Final = 32
# Filters that HDF5 itself brings; others would load foreign code.
_FILTERS: Final = frozenset({1, 2, 3, 4, 5, 6, 32000})
_LINKED: Final = "it is a link, which is not followed"
_LINK_FIX: Final = "copy the data into this file, for instance with h5repack or MATLAB's save"


class Table:
    """The datasets of a file by their path; the fields of compound ones as PATH.FIELD."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Walks the file without reading a value."""
        import h5py

        self.h5, self.max_bytes = h5py, max_bytes
        self.file = h5py.File(file, "r", locking=False)
        self.columns: list[Description] = []
        self.places: dict[str, tuple[str, str | None]] = {}
        self.seen: set[Any] = set()
        self._walk(self.file, "", 0)

    def read(self, wanted: list[str]) -> Parts:
        """The columns wanted, after their declared sizes have been checked together."""
        total = 0
        for text in wanted:
            path, _ = self.places[Selection.of(text).name]
            total += self._checked(self.file[path], text)
        if total > self.max_bytes:
            raise too_large(total, self.max_bytes)
        return {text: [numbers(self._values(text), text)] for text in wanted}

    def _walk(self, group: Any, prefix: str, depth: int) -> None:
        for name in group:
            path = f"{prefix}{name}"
            link = group.get(name, getlink=True)
            if isinstance(link, self.h5.SoftLink | self.h5.ExternalLink):
                self.columns.append(describe(path, why=_LINKED, fix=_LINK_FIX))
                continue
            item = group[name]
            identity = self.h5.h5o.get_info(item.id).addr
            if identity in self.seen or len(self.seen) > _MOST_OBJECTS:
                continue
            self.seen.add(identity)
            if isinstance(item, self.h5.Group):
                # MATLAB keeps what cells refer to in groups of its own.
                if depth < _DEEPEST and name not in {"#refs#", "#subsystem#"}:
                    self._walk(item, f"{path}/", depth + 1)
            elif isinstance(item, self.h5.Dataset):
                self._dataset(path, item)

    def _dataset(self, path: str, item: Any) -> None:
        if item.attrs.get("MATLAB_empty", 0) or _text(item.attrs.get("MATLAB_class")) == "char":
            return
        unit = next(
            (_text(item.attrs[key]) for key in ("units", "unit", "Units", "Unit") if key in item.attrs), None
        )
        shape = _shape(item)
        fields = item.dtype.names
        if fields is not None and tuple(fields) != ("real", "imag"):
            for field in fields:
                kind = item.dtype[field]
                why = None if kind.kind in "fiub" and kind.shape == () else "it holds no plain numbers"
                self._add(f"{path}.{field}", path, field, describe(f"{path}.{field}", shape=shape, why=why))
            return
        kind = item.dtype
        complex = fields is not None or kind.kind == "c"
        why = None if complex or kind.kind in "fiub" else "it holds no plain numbers"
        if why is None or item.shape not in {(), (1,)}:
            self._add(path, path, None, describe(path, unit=unit, shape=shape, complex=complex, why=why))

    def _add(self, name: str, path: str, field: str | None, description: Description) -> None:
        self.places[name] = (path, field)
        self.columns.append(description)

    def _checked(self, item: Any, column: str) -> int:
        """Bytes that a dataset unpacks to; refuses what lies elsewhere or needs foreign code."""
        plan = item.id.get_create_plist()
        if item.is_virtual or plan.get_external_count() > 0:
            raise Refused("its values lie in another file", _LINK_FIX, column=column)
        for i in range(plan.get_nfilters()):
            if plan.get_filter(i)[0] not in _FILTERS:
                raise Refused(
                    "it is packed by a filter that HDF5 does not bring itself",
                    "write it again with gzip or without compression (h5repack -f NONE)",
                    column=column,
                )
        size: int = math.prod(item.shape) * max(item.dtype.itemsize, 8)
        chunk: int = math.prod(item.chunks or (0,)) * item.dtype.itemsize
        if item.chunks is None and item.id.get_storage_size() < math.prod(item.shape) * item.dtype.itemsize:
            raise Refused("its values are not all in the file", "record or export it again", column=column)
        if item.chunks is not None:
            wanted = math.prod(-(-n // c) for n, c in zip(item.shape, item.chunks, strict=True))
            if wanted <= self.max_bytes // max(chunk, 1) and item.id.get_num_chunks() < wanted:
                raise Refused(
                    "its values are not all in the file", "record or export it again", column=column
                )
        return max(size, chunk)

    def _values(self, text: str) -> NDArray[Any]:
        path, field = self.places[Selection.of(text).name]
        item = self.file[path]
        values: NDArray[Any] = item[()] if field is None else item[field]
        if values.dtype.names is not None:
            values = values["real"] + 1j * values["imag"]
        return values.T if "MATLAB_class" in item.attrs else values


def _shape(item: Any) -> tuple[int, ...]:
    shape: tuple[int, ...] = item.shape
    return shape[::-1] if "MATLAB_class" in item.attrs else shape


def _text(value: Any) -> str | None:
    if isinstance(value, bytes | np.bytes_):
        return value.decode("utf-8", errors="replace")
    return value if isinstance(value, str) else None
