"""NI TDMS, with the extra `tdms`."""

from __future__ import annotations

from pathlib import Path

from .isolated import open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int) -> Source:
    """The channels of a TDMS file.

    Raises UsageError without npTDMS; DataError on damage and on more than `max_bytes` declared.
    """
    return open_isolated(file, "tdms", "TDMS", max_bytes, needs=("nptdms", "tdms"))
