"""Parquet, after its footer has been checked against the memory allowed."""

from __future__ import annotations

from pathlib import Path

from .._core import DataError
from ..errors import refuse
from .isolated import DAMAGED, open_isolated
from .source import Source
from .thrift import Compact, Malformed

_NUMBER_BYTES = 8
_MAX_FOOTER = 64 << 20


def _declared(file: Path) -> tuple[int, int]:
    """Rows and uncompressed bytes that the footer declares (FileMetaData fields 3 and 4, ColumnMetaData
    field 6).
    """
    with file.open("rb") as handle:
        size = handle.seek(0, 2)
        if size < 12:
            raise Malformed("the file is too short")
        handle.seek(size - 8)
        tail = handle.read(8)
        length = int.from_bytes(tail[:4], "little")
        if tail[4:] != b"PAR1":
            raise Malformed("the end mark is missing")
        if length > min(size - 12, _MAX_FOOTER):
            raise Malformed("the footer is longer than the file")
        handle.seek(size - 8 - length)
        meta = Compact(handle.read(length)).struct()
    rows, groups = meta.get(3), meta.get(4)
    if not isinstance(rows, int) or rows < 0 or not isinstance(groups, list):
        raise Malformed("the footer does not say how many rows there are")
    total = 0
    for group in groups:
        for chunk in group.get(1, []) if isinstance(group, dict) else []:
            column = chunk.get(3)
            total += max(int(column.get(6, 0)), 0) if isinstance(column, dict) else 0
    return rows, total


def open_file(file: Path, max_bytes: int) -> Source:
    """The columns of a Parquet file. Raises DataError on damage and on more than `max_bytes` declared."""
    name = str(file)
    try:
        rows, declared = _declared(file)
    except (Malformed, AttributeError, TypeError, ValueError) as error:
        raise refuse(
            DataError, f"this Parquet file cannot be read ({error})", file=name, fix=DAMAGED
        ) from error
    if max(declared, rows * _NUMBER_BYTES) > max_bytes:
        raise refuse(
            DataError,
            f"it unpacks to {max(declared, rows * _NUMBER_BYTES)} bytes, more than the {max_bytes} allowed",
            file=name,
            fix="cut the recording, or raise max_bytes",
        )
    return open_isolated(file, "arrow", "Parquet", max_bytes)
