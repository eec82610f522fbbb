"""ASAM MDF, with the extra `mdf`."""

from __future__ import annotations

import os
from pathlib import Path

from ..._core import DataError
from ...errors import refuse
from .isolated import open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int, dbc: str | None = None) -> Source:
    """The channels of an MDF file; the file `dbc` describes the frames of a CAN bus in it.

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
    given = {} if dbc is None else {"dbc": os.path.abspath(dbc)}
    return open_isolated(file, "mdf", "MDF", max_bytes, needs=("asammdf", "mdf"), given=given)
