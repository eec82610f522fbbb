"""Feather version 2 and Arrow IPC files and streams, through arro3."""

from __future__ import annotations

from pathlib import Path

from .arrow import from_file
from .source import Source


def open_file(file: Path, max_bytes: int) -> Source:
    """The columns of a Feather or Arrow IPC file. Raises DataError on damage."""
    import arro3.io

    name = str(file)
    with file.open("rb") as handle:
        whole = handle.read(6) == b"ARROW1"
    read = arro3.io.read_ipc if whole else arro3.io.read_ipc_stream
    return from_file(name, lambda: read(name), max_bytes, "Arrow")
