"""Parquet and Arrow IPC by arro3, batch by batch so that memory stays bounded."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..source import MISSING_FIX
from . import NUMBER_BYTES, Parts, Refused, describe, too_large

_BATCH_ROWS = 65_536


class Table:
    """The columns of a Parquet file, an Arrow file or an Arrow stream."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Reads the schema only."""
        self.file, self.max_bytes = file, max_bytes
        schema = self._reader().schema
        fields = [schema.field(i) for i in range(len(schema.names))]
        self.columns = [
            describe(str(field.name), why=None if _plain(field.type) else "it holds no plain numbers")
            for field in fields
        ]

    def read(self, wanted: list[str]) -> Parts:
        """The columns wanted; refuses missing values."""
        parts: Parts = {name: [] for name in wanted}
        rows = 0
        for batch in self._reader():
            for name in wanted:
                column = batch.column(name)
                if column.null_count:
                    gap = next(row for row, value in enumerate(iter(column)) if value.as_py() is None)
                    raise Refused("the value is missing", MISSING_FIX, column=name, row=rows + gap)
                parts[name].append(np.ascontiguousarray(column.to_numpy(), dtype="<f8"))
            rows += batch.num_rows
            if rows * NUMBER_BYTES * len(wanted) > self.max_bytes:
                raise too_large(rows * NUMBER_BYTES * len(wanted), self.max_bytes)
        return parts

    def _reader(self) -> Any:
        import arro3.io

        with open(self.file, "rb") as handle:
            head = handle.read(6)
        if head.startswith(b"PAR1"):
            return arro3.io.read_parquet(self.file, batch_size=_BATCH_ROWS)
        return (arro3.io.read_ipc if head == b"ARROW1" else arro3.io.read_ipc_stream)(self.file)


def _plain(kind: Any) -> bool:
    """Whether a column of this Arrow type holds real numbers."""
    types = type(kind)
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind))
