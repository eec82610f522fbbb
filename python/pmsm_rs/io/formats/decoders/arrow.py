"""Parquet and Arrow IPC by arro3."""

from __future__ import annotations

from typing import Any

from ..arrow import BATCH_VALUES, members, parts
from ..member import Wanted
from . import Parts


class Table:
    """The columns of a Parquet file, an Arrow file or an Arrow stream."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Reads the schema only."""
        self.file, self.max_bytes = file, max_bytes
        self.members = members(self._reader(1).schema)

    def read(self, wanted: list[Wanted]) -> Parts:
        """The columns wanted, batch by batch."""
        batch_rows = max(1, BATCH_VALUES // len(self.members))
        return parts(self._reader(batch_rows), wanted, self.max_bytes)

    def _reader(self, batch_rows: int) -> Any:
        import arro3.io

        with open(self.file, "rb") as handle:
            head = handle.read(6)
        if head.startswith(b"PAR1"):
            return arro3.io.read_parquet(self.file, batch_size=batch_rows)
        return (arro3.io.read_ipc if head == b"ARROW1" else arro3.io.read_ipc_stream)(self.file)
