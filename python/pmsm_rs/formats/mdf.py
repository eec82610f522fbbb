"""ASAM MDF, with the extra `mdf`."""

from __future__ import annotations

from pathlib import Path

from .._core import DataError
from ..errors import refuse
from .isolated import open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int) -> Source:
    """The channels of an MDF file.

    Raises UsageError without asammdf; DataError on damage, on channels of different time bases, and on more
    than `max_bytes` declared.
    """
    with file.open("rb") as handle:
        unfinished = handle.read(7) == b"UnFinMF"
    if unfinished:
        raise refuse(
            DataError,
            "this MDF file was never finished",
            file=str(file),
            fix="close it with the tool that recorded it, or finalize it with asammdf",
        )
    return open_isolated(file, "mdf", "MDF", max_bytes, needs=("asammdf", "mdf"))
