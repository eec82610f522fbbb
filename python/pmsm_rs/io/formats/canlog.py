"""Which of the usual logs of a CAN bus a file is, by its first bytes."""

from __future__ import annotations

import re
from typing import Final

READERS: Final = {
    "blf": "BLFReader",
    "asc": "ASCReader",
    "candump": "CanutilsLogReader",
    "trc": "TRCReader",
    "csv": "CSVReader",
}
"""The class of python-can that reads each kind."""
_KINDS: Final = (
    ("blf", re.compile(rb"LOGG")),
    ("asc", re.compile(rb"\s*(date [^\r\n]*\d{4}\s*[\r\n]+)?base +(hex|dec)\b", re.IGNORECASE)),
    ("candump", re.compile(rb"\(\d+\.\d+\) +\S+ +[0-9A-Fa-f]{3,8}#")),
    ("trc", re.compile(rb";\$FILEVERSION=")),
    ("csv", re.compile(rb"timestamp,arbitration_id,extended,remote,error,dlc,data")),
)


def log_kind(head: bytes) -> str | None:
    """The kind of a log, a key of READERS, None where the file is none."""
    return next((kind for kind, start in _KINDS if start.match(head)), None)
