"""HDF5 and MATLAB v7.3 by h5py.

Links and storage that lead out of the file are never followed: an HDF5 file may name any other file as the
place of its data. MATLAB stores matrices transposed and complex numbers as pairs.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..gate import take, within
from ..member import BOOLEAN, COMPLEX, NUMBER_BYTES, TEXT, Member, Refused, Wanted, kind_of
from . import Parts

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
        self.members: list[Member] = []
        self.places: list[tuple[str, str | None]] = []
        self.seen: set[Any] = set()
        self._walk(self.file, "", 0)

    def read(self, wanted: list[Wanted]) -> Parts:
        """The datasets and fields wanted, after their declared sizes have been checked together."""
        first = {item.index: item.column for item in reversed(wanted)}
        within(
            sum(self._checked(self.file[self.places[k][0]], name) for k, name in first.items()),
            self.max_bytes,
        )
        out: Parts = []
        last, values = -1, None
        for item in wanted:
            if item.index != last:
                values, last = self._values(item.index), item.index
            out.append([take(values, item)])
        return out

    def _walk(self, group: Any, path: str, depth: int) -> None:
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, self.h5.SoftLink | self.h5.ExternalLink):
                self._add(Member(name, path, why=_LINKED, fix=_LINK_FIX), "", None)
                continue
            item = group[name]
            identity = self.h5.h5o.get_info(item.id).addr
            if identity in self.seen:
                continue
            self.seen.add(identity)
            if isinstance(item, self.h5.Group):
                # MATLAB keeps what cells refer to in groups of its own.
                if depth < _DEEPEST and name not in {"#refs#", "#subsystem#"}:
                    self._walk(item, f"{path}/{name}" if path else name, depth + 1)
            elif isinstance(item, self.h5.Dataset):
                self._dataset(name, path, item)

    def _dataset(self, name: str, group: str, item: Any) -> None:
        if item.attrs.get("MATLAB_empty", 0):
            return
        unit = next(
            (_text(item.attrs[key]) for key in ("units", "unit", "Units", "Unit") if key in item.attrs), None
        )
        shape, path = _shape(item), f"{group}/{name}"
        matlab = _text(item.attrs.get("MATLAB_class"))
        fields = item.dtype.names
        if fields is not None and tuple(fields) != ("real", "imag"):
            for field in fields:
                inner = item.dtype[field]
                kind = kind_of(inner)
                why = None if inner.shape == () else "it holds a list in every row"
                self._add(Member(f"{name}.{field}", group, kind=kind, shape=shape, why=why), path, field)
            return
        kind = COMPLEX if fields is not None else kind_of(item.dtype)
        if self.h5.check_string_dtype(item.dtype) is not None:
            kind = TEXT
        elif matlab == "char":
            # MATLAB keeps a string as a row of characters, which lie here in a column.
            kind, shape = TEXT, shape[:1]
        elif matlab == "logical":
            kind = BOOLEAN
        self._add(Member(name, group, kind=kind, shape=shape, unit=unit or None), path, None)

    def _add(self, member: Member, path: str, field: str | None) -> None:
        self.places.append((path, field))
        self.members.append(member)

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
        size: int = math.prod(item.shape) * max(item.dtype.itemsize, NUMBER_BYTES)
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

    def _values(self, index: int) -> NDArray[Any]:
        path, field = self.places[index]
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
