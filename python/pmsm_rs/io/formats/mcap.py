"""MCAP, with the extra `mcap`; for messages of ROS with `ros`."""

from __future__ import annotations

from pathlib import Path

from .isolated import SLOW, open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int) -> Source:
    """The topics of an MCAP file.

    Raises UsageError without mcap; DataError on damage, on messages of ROS without rosbags, and on more than
    `max_bytes` unpacked.
    """
    return open_isolated(file, "mcap", "MCAP", max_bytes, needs=("mcap", "mcap"), speed=SLOW)
