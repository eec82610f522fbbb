"""JSON: columns as lists of numbers, records one after the other or one per line, moteus inductance logs.

The logs hold, per level of i_d (A), records of the electrical speed `omega` (rad/s) and of `y`, the q-axis
voltage without the drop over the resistance (V). Source: mjbots/moteus, utils.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import refuse
from .source import PLAIN_FIX, Source, from_arrays, short_names

# Python's objects take some thirty times the memory of the text that they were read from.
_EXPANSION: Final = 32
_DEEPEST: Final = 8
_FIX: Final = 'write {"t": [...], "i_d": [...]} or one record {"t": ..., "i_d": ...} per line'
_MOTEUS: Final = frozenset({"raw", "params", "regressions"})


def open_file(file: Path, max_bytes: int) -> Source:
    """The columns of a JSON file. Raises DataError on damage, repeated names, and more than `max_bytes`."""
    name = str(file)
    size = file.stat().st_size
    if size * _EXPANSION > max_bytes:
        raise refuse(
            DataError,
            f"as JSON it needs about {size * _EXPANSION} bytes, more than the {max_bytes} allowed",
            file=name,
            fix="store it as Parquet, or raise max_bytes",
        )
    content = _parse(file.read_bytes(), name)
    if isinstance(content, dict) and set(content) >= _MOTEUS:
        return _moteus(content, name)
    columns = _records(content, name) if isinstance(content, list) else dict(_columns(content, "", 0))
    if not columns:
        raise refuse(DataError, "it holds no lists of numbers", file=name, fix=_FIX)
    short = short_names(columns)
    arrays = {short[path]: _array(values, short[path], name) for path, values in columns.items()}
    return from_arrays(name, arrays)


def _parse(data: bytes, file: str) -> Any:
    try:
        text = data.decode("utf-8-sig")
        try:
            return json.loads(text, object_pairs_hook=_once)
        except json.JSONDecodeError:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) < 2 or not lines[0].lstrip().startswith("{") or not lines[0].rstrip().endswith("}"):
                raise
        records = []
        for number, line in enumerate(text.splitlines(), start=1):
            if line.strip():
                try:
                    records.append(json.loads(line, object_pairs_hook=_once))
                except json.JSONDecodeError as error:
                    raise refuse(
                        DataError,
                        f"this is no valid JSON ({error.msg})",
                        file=file,
                        row=number,
                        place=f"line {number}",
                        fix="complete or remove the line; a file cut short ends like this",
                    ) from error
        return records
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        what = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise refuse(
            DataError,
            f"this is no valid JSON ({what})",
            file=file,
            fix="export it again; it may be cut short",
        ) from error


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"the name '{next(n for n in names if names.count(n) > 1)}' is there twice")
    return found


def _columns(content: Any, prefix: str, depth: int) -> Iterable[tuple[str, list[Any]]]:
    """The lists in a tree of mappings, by their path."""
    if not isinstance(content, Mapping) or depth > _DEEPEST:
        return
    for name, value in content.items():
        if isinstance(value, list):
            yield f"{prefix}{name}", value
        else:
            yield from _columns(value, f"{prefix}{name}/", depth + 1)


def _records(rows: list[Any], file: str) -> dict[str, list[Any]]:
    """The columns of a list of mappings that all have the same names."""
    first = rows[0] if rows else None
    if not isinstance(first, Mapping):
        raise refuse(DataError, "it is a list without names", file=file, fix=_FIX)
    for row, record in enumerate(rows):
        if not isinstance(record, Mapping) or set(record) != set(first):
            raise refuse(
                DataError,
                "the record does not have the names of the first one",
                file=file,
                row=row,
                place=f"record {row} (counting from 0)",
                fix="give every record the same names",
            )
    return {name: [record[name] for record in rows] for name in first}


def _array(values: list[Any], column: str, file: str) -> NDArray[Any]:
    odd = next((k for k, v in enumerate(values) if v is None or isinstance(v, str | dict)), None)
    if odd is not None and any(isinstance(v, int | float) for v in values):
        what = "the value is missing" if values[odd] is None else f"'{str(values[odd])[:40]}' is no number"
        raise refuse(
            DataError,
            what,
            file=file,
            row=odd,
            place=f"row {odd} (counting from 0)",
            column=column,
            fix="complete or remove the row",
        )
    try:
        array = np.array(values)
    except (ValueError, OverflowError):
        array = np.array([None])
    if array.dtype.kind == "O":
        raise refuse(DataError, "it holds no plain numbers", file=file, column=column, fix=PLAIN_FIX)
    return array


def _moteus(content: Mapping[str, Any], file: str) -> Source:
    """i_d, omega_e and y of an inductance log, level by level from the highest i_d."""
    rows: list[tuple[float, float, float]] = []
    try:
        for level, records in sorted(content["raw"].items(), key=lambda item: -float(item[0])):
            rows += [(float(level), float(record["omega"]), float(record["y"])) for record in records]
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise refuse(
            DataError, "this moteus inductance log is not complete", file=file, fix="measure it again"
        ) from error
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return from_arrays(file, {name: table[:, k] for k, name in enumerate(("i_d", "omega_e", "y"))})
