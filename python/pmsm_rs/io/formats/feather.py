"""Feather version 2: Arrow IPC files and streams."""

from __future__ import annotations

from pathlib import Path

from .isolated import open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int) -> Source:
    """The columns of a Feather or Arrow IPC file. Raises DataError on damage and on more than `max_bytes`."""
    return open_isolated(file, "arrow", "Arrow", max_bytes)
