"""Measured and modelled trajectories as a Parquet file."""

from __future__ import annotations

import os

from .._core import UsageError
from ..errors import refuse
from . import tabular
from .findings import DiagnosisValues

_PARTS = ("_measured", "_before", "_after")


def write(answer: DiagnosisValues, path: str | os.PathLike[str]) -> None:
    """Writes t and NAME_measured, NAME_before, NAME_after of the validation run, or else of the recording.

    Raises UsageError where there are no traces or the file cannot be written.
    """
    if answer.shown is None:
        raise refuse(UsageError, "there are no trajectories to write", fix="diagnose a recording first")
    trace = answer.traces[answer.shown]
    names = [name for name in ("t", "recording") if name in trace]
    names += [name for name in trace if name.endswith(_PARTS)]
    tabular.write(path, {name: trace[name] for name in names})
