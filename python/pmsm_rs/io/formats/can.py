"""Logs of a CAN bus, with the extra `can`."""

from __future__ import annotations

import os
from pathlib import Path

from ..._core import DataError, UsageError
from ...errors import refuse
from .isolated import SLOW, open_isolated
from .source import Source


def open_file(file: Path, max_bytes: int, dbc: str | None = None) -> Source:
    """The signals of a log of a CAN bus, as the file `dbc` describes them.

    Raises UsageError without python-can and cantools and where there is no file `dbc`; DataError without a
    `dbc`, on damage, and on more than `max_bytes` unpacked.
    """
    name = str(file)
    if dbc is None:
        raise refuse(
            DataError,
            "this is a log of a CAN bus, whose frames say nothing without a description of the bus",
            file=name,
            fix='name it in the machine file: dbc = "FILE.dbc" in [columns]',
        )
    if not Path(dbc).is_file():
        raise refuse(
            UsageError,
            "there is no such file",
            file=dbc,
            fix="correct dbc in [columns]; its folder is that of the machine file",
        )
    return open_isolated(
        file,
        "can",
        "CAN log",
        max_bytes,
        needs=(("can", "cantools"), "can"),
        speed=SLOW,
        given={"dbc": os.path.abspath(dbc)},
    )
