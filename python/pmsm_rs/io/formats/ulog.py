"""PX4 ulog, with the extra `ulog`."""

from __future__ import annotations

from pathlib import Path

from .isolated import SLOW, open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int) -> Source:
    """The fields of a PX4 flight log.

    Raises UsageError without pyulog; DataError on damage and on more than `max_bytes` unpacked.
    """
    return open_isolated(file, "ulog", "ulog", max_bytes, needs=("pyulog", "ulog"), speed=SLOW)
