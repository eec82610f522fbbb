"""JSON: columns as lists of numbers, records one after the other or one per line, moteus inductance logs.

The logs hold, per level of i_d (A), records of the electrical speed `omega` (rad/s) and of `y`, the q-axis
voltage without the drop over the resistance (V). Source: mjbots/moteus, utils.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from ..._core import DataError
from ...errors import refuse
from ...mistaken import expect_no_answer
from .gate import admit, few_enough, one_by_one
from .listed import array_of, shape_of
from .member import UNKNOWN, Member, Refused
from .source import Source

# Python's objects take some thirty times the memory of the text that they were read from.
_EXPANSION: Final = 32
_DEEPEST: Final = 8
_FIX: Final = 'write {"t": [...], "i_d": [...]} or one record {"t": ..., "i_d": ...} per line'
_MOTEUS: Final = frozenset({"raw", "params", "regressions"})

_Columns = list[tuple[str, str, list[Any]]]
"""Group, name and values of each column."""


class Repeated(list[tuple[str, Any]]):
    """The names and values of an object that has a name twice."""


def open_file(file: Path, max_bytes: int) -> Source:
    """The columns of a JSON file. Raises DataError on damage and on more than `max_bytes`."""
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
    expect_no_answer(content, name)
    if isinstance(content, dict) and set(content) >= _MOTEUS:
        columns = _moteus(content, name)
    elif pairs_of(content) is None and isinstance(content, list):
        columns = _records(content, name)
    else:
        columns = list(_tree(content, "", 0))
    if not columns:
        raise refuse(DataError, "it holds no lists of numbers", file=name, fix=_FIX)
    try:
        few_enough(len(columns))
        members = [
            Member(column, group, kind=UNKNOWN, shape=shape_of(values)) for group, column, values in columns
        ]
    except Refused as refused:
        raise refuse(DataError, refused.problem, file=name, fix=refused.fix) from refused

    def load(index: int) -> NDArray[Any]:
        return array_of(columns[index][2], members[index].name)

    return admit(name, members, one_by_one(load), max_bytes)


def _parse(data: bytes, file: str) -> Any:
    try:
        text = data.decode("utf-8-sig")
        try:
            return json.loads(text, object_pairs_hook=object_of)
        except json.JSONDecodeError:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) < 2 or not lines[0].lstrip().startswith("{") or not lines[0].rstrip().endswith("}"):
                raise
        records = []
        for number, line in enumerate(text.splitlines(), start=1):
            if line.strip():
                try:
                    records.append(json.loads(line, object_pairs_hook=object_of))
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


def object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any] | Repeated:
    """An object of JSON; its names and values as they come where it has a name twice."""
    found = dict(pairs)
    return found if len(found) == len(pairs) else Repeated(pairs)


def pairs_of(content: object) -> Iterable[tuple[str, Any]] | None:
    """The names and values of what `object_of` gave, None where `content` is no object."""
    if isinstance(content, Repeated):
        return content
    return content.items() if isinstance(content, Mapping) else None


def _tree(content: object, group: str, depth: int) -> Iterator[tuple[str, str, list[Any]]]:
    """The lists in a tree of objects."""
    pairs = pairs_of(content)
    if pairs is None or depth > _DEEPEST:
        return
    for name, value in pairs:
        if isinstance(value, list) and not isinstance(value, Repeated):
            yield group, name, value
        elif pairs_of(value) is not None:
            yield from _tree(value, f"{group}/{name}" if group else name, depth + 1)


def _records(rows: list[Any], file: str) -> _Columns:
    """The columns of a list of objects that all have the same names."""
    first = pairs_of(rows[0]) if rows else None
    if first is None:
        raise refuse(DataError, "it is a list without names", file=file, fix=_FIX)
    names = sorted(name for name, _ in first)
    values: dict[str, list[Any]] = {name: [] for name in names}
    for row, record in enumerate(rows):
        pairs = pairs_of(record)
        if pairs is None or sorted(name for name, _ in pairs) != names:
            raise refuse(
                DataError,
                "the record does not have the names of the first one",
                file=file,
                row=row,
                place=f"record {row} (counting from 0)",
                fix="give every record the same names",
            )
        for name, value in pairs:
            values[name].append(value)
    # A name that the records have k times has k values per record.
    times = {name: len(column) // len(rows) for name, column in values.items()}
    return [("", name, values[name][k :: times[name]]) for name in values for k in range(times[name])]


def _moteus(content: Mapping[str, Any], file: str) -> _Columns:
    """i_d, omega_e and y of an inductance log, level by level from the highest i_d."""
    rows: list[tuple[float, float, float]] = []
    try:
        for level, records in sorted(content["raw"].items(), key=lambda item: -float(item[0])):
            rows += [(float(level), float(record["omega"]), float(record["y"])) for record in records]
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise refuse(
            DataError, "this moteus inductance log is not complete", file=file, fix="measure it again"
        ) from error
    return [("", name, [row[k] for row in rows]) for k, name in enumerate(("i_d", "omega_e", "y"))]
