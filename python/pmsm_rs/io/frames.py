"""Recordings that are in memory already: Arrow streams, pandas frames, xarray Datasets, structured arrays,
mappings of arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._core import DataError
from ..errors import refuse
from ..quantities.canonical import CANONICAL
from .formats.arrow import from_stream
from .formats.gate import admit, checked_limit, one_by_one
from .formats.listed import array_of, shape_of
from .formats.member import UNKNOWN, Member, kind_of
from .formats.source import Source


def frame_source(data: Any, max_bytes: int) -> Source:
    """The columns of a table in memory.

    Raises UsageError where `max_bytes` is no number of bytes, DataError where `data` is no table.
    """
    max_bytes = checked_limit(max_bytes)
    if _is_xarray(data):
        return _arrays(_of_dataset(data), max_bytes)
    if isinstance(data, Mapping):
        return _arrays([(str(name), plain(values, str(name))) for name, values in data.items()], max_bytes)
    if isinstance(data, np.ndarray) and data.dtype.names is not None:
        return _arrays([(name, data[name]) for name in data.dtype.names], max_bytes)
    if _is_pandas(data):
        names = [str(name) for name in data.columns]
        return _arrays([(name, data.iloc[:, i].to_numpy()) for i, name in enumerate(names)], max_bytes)
    if hasattr(data, "__arrow_c_stream__"):
        import arro3.core

        return from_stream(lambda: arro3.core.RecordBatchReader.from_stream(data), max_bytes)
    raise refuse(
        DataError,
        f"a {type(data).__name__} is no recording",
        fix="give a file name, a mapping of arrays, a structured array, or a frame",
    )


def _arrays(columns: list[tuple[str, Any]], max_bytes: int) -> Source:
    """A source over named arrays or lists."""
    values = [given if isinstance(given, list | tuple) else np.asanyarray(given) for _, given in columns]
    members = [_member(name, given) for (name, _), given in zip(columns, values, strict=True)]

    def load(index: int) -> Any:
        given = values[index]
        return array_of(given, members[index].name) if isinstance(given, list | tuple) else given

    return admit(None, members, one_by_one(load), max_bytes)


def _member(name: str, values: Any) -> Member:
    if isinstance(values, list | tuple):
        return Member(name, kind=UNKNOWN, shape=shape_of(values))
    ready = values.dtype == np.float64 and values.flags.c_contiguous and values.flags.aligned
    return Member(name, kind=kind_of(values.dtype), shape=values.shape, held=ready)


def plain(values: Any, name: str) -> Any:
    """`values` without its unit: quantities of pint and alike (`.to(unit).magnitude`) are converted to SI
    first.
    """
    if hasattr(values, "to") and hasattr(values, "magnitude"):
        unit = CANONICAL[name].unit if name in CANONICAL else None
        spelled = {"N·m": "newton * meter", "°C": "degC"}.get(unit or "", unit)
        return values.to(spelled).magnitude if spelled else values.magnitude
    return values.to_numpy() if hasattr(values, "to_numpy") else values


def _is_xarray(data: object) -> bool:
    return type(data).__module__.split(".")[0] == "xarray" and hasattr(data, "data_vars")


def _of_dataset(data: Any) -> list[tuple[str, Any]]:
    """Coordinates and variables along one dimension; a unit in `attrs` is written behind the name, unless it
    is that of the canonical column.
    """
    out = []
    for name, variable in {**data.coords, **data.data_vars}.items():
        if variable.ndim != 1:
            continue
        unit = variable.attrs.get("units")
        known = CANONICAL.get(str(name))
        told = unit is not None and not (known is not None and known.unit == unit)
        out.append((f"{name} [{unit}]" if told else str(name), variable.to_numpy()))
    return out


def _is_pandas(data: object) -> bool:
    return (
        type(data).__module__.split(".")[0] == "pandas" and hasattr(data, "iloc") and hasattr(data, "columns")
    )
