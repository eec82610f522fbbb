"""Columns of numbers as a file."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .. import atomic
from .._core import UsageError
from ..errors import refuse

if TYPE_CHECKING:
    from arro3.core import Table


def table(columns: Mapping[str, NDArray[np.float64]]) -> Table:
    """Columns of equal length as an Arrow table of float64."""
    import arro3.core as arrow

    arrays = {
        name: arrow.Array.from_numpy(np.ascontiguousarray(values, dtype=np.float64))
        for name, values in columns.items()
    }
    return arrow.Table.from_pydict(arrays)  # type: ignore[arg-type]


def write(path: str | os.PathLike[str], columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Writes columns of equal length as Parquet, or as CSV where the name ends in .csv; whole or not at all.

    Raises UsageError where the name ends otherwise or the file cannot be written.
    """
    import arro3.io

    kind = Path(path).suffix.lower()
    if kind not in (".parquet", ".csv"):
        raise refuse(
            UsageError, f"'{kind}' is no kind of file that is written", file=str(path), fix="name it .parquet"
        )
    data = table(columns)

    def fill(draft: Path) -> None:
        # It panics where a disk is full, so it does not get to write to one.
        content = io.BytesIO()
        if kind == ".csv":
            arro3.io.write_csv(data, content)
        else:
            arro3.io.write_parquet(data, content, compression="zstd(3)")
        draft.write_bytes(content.getbuffer())

    atomic.write(path, fill)
