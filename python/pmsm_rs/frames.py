"""Recordings that are in memory already: Arrow streams, pandas frames, structured arrays, mappings of
arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ._core import DataError
from .errors import refuse
from .formats.arrow import from_reader
from .formats.source import Source, from_arrays
from .quantities import CANONICAL


def frame_source(data: Any, max_bytes: int) -> Source:
    """The columns of a table in memory. Raises DataError where it is none."""
    if isinstance(data, Mapping):
        return from_arrays(None, {str(name): plain(values, str(name)) for name, values in data.items()})
    if isinstance(data, np.ndarray) and data.dtype.names is not None:
        return from_arrays(None, {name: data[name] for name in data.dtype.names})
    if _is_pandas(data):
        names = [str(name) for name in data.columns]
        arrays = {name: data.iloc[:, i].to_numpy() for i, name in enumerate(names)}
        return replace(from_arrays(None, arrays), names=tuple(names))
    if hasattr(data, "__arrow_c_stream__"):
        import arro3.core

        table = arro3.core.Table.from_arrow(data)
        return from_reader(None, lambda: arro3.core.RecordBatchReader.from_stream(table), max_bytes)
    raise refuse(
        DataError,
        f"a {type(data).__name__} is no recording",
        fix="give a file name, a mapping of arrays, a structured array, or a frame",
    )


def plain(values: Any, name: str) -> Any:
    """`values` without its unit: quantities of pint and alike (`.to(unit).magnitude`) are converted to SI
    first.
    """
    if hasattr(values, "to") and hasattr(values, "magnitude"):
        unit = CANONICAL[name].unit if name in CANONICAL else None
        spelled = {"N·m": "newton * meter", "°C": "degC"}.get(unit or "", unit)
        return values.to(spelled).magnitude if spelled else values.magnitude
    return values.to_numpy() if hasattr(values, "to_numpy") else values


def _is_pandas(data: object) -> bool:
    return (
        type(data).__module__.split(".")[0] == "pandas" and hasattr(data, "iloc") and hasattr(data, "columns")
    )
