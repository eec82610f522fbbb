"""Where an answer comes from: the file with its date, and what was stated of the machine."""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Final

from .._core import Machine, Recording

_STATED: Final = ("n_p", "r_s", "l_d", "l_q", "psi_m", "j", "b", "v_dc", "i_rated", "f_sample")


def stated(machine: Machine, recordings: Sequence[Recording]) -> dict[str, Any]:
    """What was stated of the machine, its drive and its load, SI units; what is unknown is left out, and so
    is the load where recordings have several.
    """
    known = {name: value for name in _STATED if (value := getattr(machine, name)) is not None}
    loads = {(recording.load, recording.load_value) for recording in recordings}
    if len(loads) == 1:
        load, value = loads.pop()
        known |= {"load": load} | ({} if value is None else {"load_value": value})
    return known


def dated(file: str | None) -> dict[str, Any]:
    """The name of a file and, where it is still there, when it was last written, UTC to the second."""
    if file is None:
        return {}
    try:
        seconds = int(os.stat(file).st_mtime)
    except OSError:
        return {"file": file}
    moment = datetime.fromtimestamp(seconds, tz=UTC)
    return {"file": file, "modified": moment.strftime("%Y-%m-%dT%H:%M:%SZ")}
