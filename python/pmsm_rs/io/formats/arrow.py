"""Columns of Arrow data, taken batch by batch so that memory stays bounded."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .gate import admit, take, within
from .member import BOOLEAN, DATE, DURATION, NUMBER, NUMBER_BYTES, OBJECT, TEXT, Member, Refused, Wanted
from .source import MISSING_FIX, Source

BATCH_VALUES: Final = 1 << 20
"""Values of all columns in a batch, where the reader chooses its size: 8 MiB."""

_KINDS: Final = (
    ("is_floating", NUMBER),
    ("is_integer", NUMBER),
    ("is_boolean", BOOLEAN),
    ("is_string", TEXT),
    ("is_large_string", TEXT),
    ("is_string_view", TEXT),
    ("is_timestamp", DATE),
    ("is_date", DATE),
    ("is_time", DATE),
    ("is_duration", DURATION),
)


def members(schema: Any) -> list[Member]:
    """The columns of an Arrow schema."""
    return [_member(schema.field(i)) for i in range(len(schema.names))]


def _member(field: Any) -> Member:
    kind = next((kind for test, kind in _KINDS if getattr(type(field.type), test)(field.type)), OBJECT)
    return Member(str(field.name), kind=kind)


def parts(batches: Iterable[Any], wanted: list[Wanted], max_bytes: int) -> list[list[NDArray[np.float64]]]:
    """The values of the columns wanted, one array per batch.

    Raises Refused on missing values, where gaps are not wanted, and on more than `max_bytes`.
    """
    out: list[list[NDArray[np.float64]]] = [[] for _ in wanted]
    rows = 0
    for batch in batches:
        within((rows + batch.num_rows) * NUMBER_BYTES * len(wanted), max_bytes)
        for item, chunks in zip(wanted, out, strict=True):
            column = batch.column(item.index)
            if column.null_count and item.gaps:
                chunks.append(with_gaps(column))
                continue
            if column.null_count:
                gap = next(row for row, value in enumerate(iter(column)) if value.as_py() is None)
                raise Refused("the value is missing", MISSING_FIX, column=item.column, row=rows + gap)
            chunks.append(take(column.to_numpy(), item))
        rows += batch.num_rows
    return out


def with_gaps(column: Any) -> NDArray[np.float64]:
    """The numbers of an Arrow column, shape (rows,), NaN where a value is missing."""
    return np.array([np.nan if value is None else value for value in column.to_pylist()], dtype=np.float64)


def from_stream(stream: Callable[[], Any], max_bytes: int) -> Source:
    """The columns of an Arrow stream in memory, of which `stream` gives a reader, anew for each pass."""
    first: list[Any] = [stream()]

    def fetch(wanted: list[Wanted]) -> list[NDArray[np.float64]]:
        # What can be read but once, such as a stream from another process, is not asked for a second time.
        reader = first.pop() if first else stream()
        columns = parts(reader, wanted, max_bytes)
        return [np.concatenate(chunks) if chunks else np.empty(0) for chunks in columns]

    return admit(None, members(first[0].schema), fetch, max_bytes)
