"""Parquet, after its footer has been checked against the memory allowed."""

from __future__ import annotations

from pathlib import Path

from ..._core import DataError
from ...errors import refuse
from .isolated import DAMAGED, open_isolated
from .source import Source
from .thrift import Compact, Malformed

_NUMBER_BYTES = 8
# Room for some fifty thousand pieces of columns; the walk through it takes about a second per megabyte.
_MAX_FOOTER = 8 << 20


def _declared(file: Path) -> tuple[int, int]:
    """Rows and uncompressed bytes that the footer declares."""
    with file.open("rb") as handle:
        size = handle.seek(0, 2)
        if size < 12:
            raise Malformed("the file is too short")
        handle.seek(size - 8)
        tail = handle.read(8)
        length = int.from_bytes(tail[:4], "little")
        if tail[4:] != b"PAR1":
            raise Malformed("the end mark is missing")
        if length > size - 12:
            raise Malformed("the footer is longer than the file")
        if length > _MAX_FOOTER:
            raise Malformed(f"the footer has {length} bytes")
        handle.seek(size - 8 - length)
        return _file_meta_data(Compact(handle.read(length)))


def _file_meta_data(at: Compact) -> tuple[int, int]:
    """num_rows (field 3), and the bytes of all row_groups (field 4)."""
    rows, total, groups = -1, 0, False
    for number, kind in at.fields():
        if number == 3:
            rows = at.integer(kind)
        elif number == 4:
            groups = True
            total += sum(_row_group(at) for _ in range(at.structures(kind)))
        else:
            at.skip(kind)
    if rows < 0 or not groups:
        raise Malformed("the footer does not say how many rows there are")
    return rows, total


def _row_group(at: Compact) -> int:
    """Bytes of the columns (field 1, required)."""
    total, chunks = 0, 0
    for number, kind in at.fields():
        if number == 1:
            chunks = at.structures(kind)
            total += sum(_column_chunk(at) for _ in range(chunks))
        else:
            at.skip(kind)
    if not chunks:
        raise Malformed("the footer has a row group without columns")
    return total


def _column_chunk(at: Compact) -> int:
    """total_uncompressed_size (field 6) of meta_data (field 3)."""
    size = None
    for number, kind in at.fields():
        if number != 3:
            at.skip(kind)
            continue
        at.structure(kind)
        for inner, inner_kind in at.fields():
            if inner == 6:
                size = max(at.integer(inner_kind), 0)
            else:
                at.skip(inner_kind)
    if size is None:
        raise Malformed("the footer has a column without a size")
    return size


def open_file(file: Path, max_bytes: int) -> Source:
    """The columns of a Parquet file. Raises DataError on damage and on more than `max_bytes` declared."""
    name = str(file)
    try:
        rows, declared = _declared(file)
    except Malformed as error:
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
