"""Reading a recording from a file or a frame."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._core import DataError, Machine
from .checks import angle_against_speed
from .columns import assemble
from .config import MachineFile, read_machine
from .errors import fact, refuse
from .formats import Source, open_source
from .frames import frame_source
from .recording import DEFAULT_MAX_BYTES, Recording


def load(
    data: Any,
    machine: str | os.PathLike[str] | MachineFile | Machine | None = None,
    *,
    max_bytes: int = DEFAULT_MAX_BYTES,
) -> Recording:
    """The recording in a file (CSV, Parquet, Feather, .mat of version 5, .npz) or a frame in memory.

    `machine` names the machine file whose [columns] and [load] tables say how to read it; with a Machine only
    its pole pairs are used, to tell electrical from mechanical angles. Nothing larger than `max_bytes` bytes
    is unpacked.

    Raises UsageError where there is no such file, MachineError for a bad machine file, and DataError, which
    names file, row, column and fix, for data that cannot be used.
    """
    described = (
        machine
        if isinstance(machine, MachineFile) or machine is None or isinstance(machine, Machine)
        else read_machine(machine)
    )
    known = described.machine if isinstance(described, MachineFile) else described
    source = (
        open_source(data, max_bytes) if isinstance(data, str | os.PathLike) else frame_source(data, max_bytes)
    )
    columns = assemble(source, described.columns if isinstance(described, MachineFile) else None)
    kind, value = (
        (described.load, described.load_value) if isinstance(described, MachineFile) else (None, None)
    )
    try:
        recording = Recording(columns, load=kind, load_value=value)
    except DataError as error:
        raise _with_place(error, source) from error
    angle_against_speed(columns, known.n_p if known is not None else None, source.file)
    return recording


def load_columns(
    data: str | os.PathLike[str],
    machine: MachineFile | Machine | None = None,
    *,
    max_bytes: int = DEFAULT_MAX_BYTES,
) -> dict[str, NDArray[np.float64]]:
    """The canonical SI columns of a file as arrays of shape (samples,), values that are not finite included.

    Raises as `load`, but for what only a Recording refuses.
    """
    source = open_source(data, max_bytes)
    return assemble(source, machine.columns if isinstance(machine, MachineFile) else None, finite=False)


def _with_place(error: DataError, source: Source) -> DataError:
    """The core's refusal with the file and with the row where the user finds it."""
    row, column, fix = fact(error, "row"), fact(error, "column"), fact(error, "fix")
    problem = fact(error, "problem")
    if not isinstance(problem, str) or not isinstance(fix, str):
        return refuse(
            DataError, str(error), file=source.file, fix="see what a recording needs in the documentation"
        )
    if row is None and "missing" in problem:
        fix += f" (the file has {', '.join(source.names[:20])}; map them in [columns])"
    number, words = source.place(row) if isinstance(row, int) else (None, None)
    return refuse(
        DataError,
        problem,
        file=source.file,
        row=number,
        place=words,
        column=column if isinstance(column, str) else None,
        fix=fix,
    )
