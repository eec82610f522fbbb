"""Bags of ROS 1 and ROS 2, with the extra `ros`."""

from __future__ import annotations

from pathlib import Path

from .isolated import SLOW, open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int) -> Source:
    """The topics of a bag.

    Raises UsageError without rosbags; DataError on damage and on more than `max_bytes` unpacked.
    """
    return open_isolated(file, "rosbag", "ROS bag", max_bytes, needs=("rosbags", "ros"), speed=SLOW)
