"""Measured and modelled trajectories as a Parquet file."""

from __future__ import annotations

import os
from typing import Any

from . import atomic
from ._core import UsageError
from .errors import refuse
from .results import Diagnosis

_PARTS = ("_measured", "_before", "_after")


def write(answer: Diagnosis, path: str | os.PathLike[str]) -> None:
    """Writes t and NAME_measured, NAME_before, NAME_after of the run that is judged.

    Raises UsageError where there are no traces or the file cannot be written.
    """
    import arro3.core as arrow
    import arro3.io
    import numpy as np

    if answer.shown is None:
        raise refuse(UsageError, "there are no trajectories to write", fix="diagnose a recording first")
    trace = answer.traces[answer.shown]
    names = ["t", *(name for name in trace if name.endswith(_PARTS))]
    arrays: dict[str, Any] = {
        name: arrow.Array.from_numpy(np.ascontiguousarray(trace[name], dtype=np.float64)) for name in names
    }
    table = arrow.Table.from_pydict(arrays)
    atomic.write(path, lambda draft: arro3.io.write_parquet(table, str(draft), compression="zstd(3)"))
