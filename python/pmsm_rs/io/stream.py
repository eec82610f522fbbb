"""Samples as they come on standard input, CSV or one JSON object per line, in batches of what is there."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..config.rules import Rules
from ..errors import refuse
from .columns import assemble
from .formats.gate import admit, few_enough, one_by_one
from .formats.json import object_of, pairs_of
from .formats.member import Member, Refused
from .formats.sniff import is_number, name_and_unit, skipped, split

NAME = "standard input"
_CHUNK = 1 << 16
_LONGEST_LINE = 1 << 20
# What the names of the columns mean is found anew for each lot of lines.
_MOST_NAMES = 1000
_MISSING = frozenset({"", "nan", "null", "na", "n/a", "inf", "+inf", "-inf"})
_SEPARATORS = (",", ";", "\t", "|")

Columns = dict[str, NDArray[np.float64]]


class Reader(Protocol):
    """Anything with `read1`, such as `sys.stdin.buffer`."""

    def read1(self, size: int, /) -> bytes:
        """What is there, at most `size` bytes; waits only if there is nothing."""


def batches(reader: Reader, rules: Rules | None) -> Iterator[Columns]:
    """Canonical SI columns, one batch for each lot of whole lines that has arrived.

    The first line that is neither blank nor a comment is a header of CSV, or an object whose keys name the
    columns. Empty fields, NaN and null are missing values, which come as NaN. The rows before a bad line are
    delivered before it is refused. Raises DataError naming the line, its column and the fix.
    """
    table: _Table | None = None
    rows = 0
    for numbered in _lots(reader):
        good: list[tuple[int, list[float]]] = []
        trouble: DataError | None = None
        for number, line in numbered:
            if skipped(line):
                continue
            try:
                if table is None:
                    table = _Objects(line, number) if line.lstrip().startswith("{") else _Text(line, number)
                    if isinstance(table, _Text):
                        continue
                good.append((number, table.row(line, number)))
            except DataError as error:
                trouble = error
                break
        if table is not None and good:
            yield _columns(table, good, rules, rows)
            rows += len(good)
        if trouble is not None:
            raise trouble
    if rows == 0:
        came = "nothing came" if table is None else "no sample came behind the header"
        raise refuse(DataError, came, file=NAME, fix="send CSV with a header, or one JSON object per line")


def _lots(reader: Reader) -> Iterator[list[tuple[int, str]]]:
    """Whole lines with their numbers from 1, as many as have arrived."""
    rest, number = b"", 0
    while True:
        chunk = reader.read1(_CHUNK)
        lines = (rest + chunk).split(b"\n")
        rest = lines.pop()
        if not chunk and rest:
            lines, rest = [rest], b""
        if len(rest) > _LONGEST_LINE:
            raise _bad("the line is longer than any sample", number + 1, "end each sample with a line feed")
        lot = [(number + k, _text(line)) for k, line in enumerate(lines, start=1)]
        number += len(lines)
        if lot:
            yield lot
        if not chunk:
            return


def _text(line: bytes) -> str:
    return line.decode("utf-8-sig", errors="replace").rstrip("\r")


def _bad(problem: str, number: int, fix: str, column: str | None = None) -> DataError:
    return refuse(DataError, problem, file=NAME, row=number, place=f"line {number}", column=column, fix=fix)


def _few_enough(names: tuple[str, ...], number: int) -> None:
    """Raises DataError on far too many names."""
    try:
        few_enough(len(names), _MOST_NAMES)
    except Refused as refused:
        raise _bad(refused.problem, number, "send the columns that are to be followed") from None


class _Table(Protocol):
    """Names and units of the columns, of which two may have one name, and how a line becomes a row."""

    names: tuple[str, ...]
    units: tuple[str | None, ...]

    def row(self, line: str, number: int) -> list[float]:
        """The values of a line in the order of `names`. Raises DataError for a line that is no row."""


class _Text:
    """Separated values behind a header."""

    def __init__(self, header: str, number: int) -> None:
        self.separator = max(_SEPARATORS, key=header.count)
        fields = [name_and_unit(field) for field in _fields(header, self.separator, number)]
        self.names = tuple(name for name, _ in fields)
        self.units = tuple(unit for _, unit in fields)
        if header.lstrip().startswith("["):
            raise _bad("this is no JSON object", number, 'send objects such as {"t": 0.0, "i_d": 1.0}')
        _few_enough(self.names, number)
        if len(self.names) < 2 or all(is_number(name, False) for name in self.names):
            raise _bad("this is no header", number, "begin with the names of the columns, such as t,v_d,v_q")
        self.comma = self.separator != ","

    def row(self, line: str, number: int) -> list[float]:
        fields = _fields(line, self.separator, number)
        if len(fields) != len(self.names):
            raise _bad(
                f"the line has {len(fields)} fields where the header has {len(self.names)}",
                number,
                "send whole lines; a stream cut short ends like this",
            )
        return [self._number(*pair, number) for pair in zip(self.names, fields, strict=True)]

    def _number(self, name: str, field: str, number: int) -> float:
        if is_number(field, False):
            return float(field.replace(" ", ""))
        if self.comma and is_number(field, True):
            return float(field.replace(" ", "").replace(",", "."))
        if field.lower() in _MISSING:
            return float("nan")
        raise _bad(f"'{field[:40]}' is no number", number, "send a number, or leave the field empty", name)


class _Objects:
    """One JSON object per line."""

    def __init__(self, line: str, number: int) -> None:
        self.names = tuple(sorted(name for name, _ in self._object(line, number)))
        self.units: tuple[str | None, ...] = (None,) * len(self.names)
        _few_enough(self.names, number)
        if not self.names:
            raise _bad("the object is empty", number, 'send objects such as {"t": 0.0, "i_d": 1.0}')

    def row(self, line: str, number: int) -> list[float]:
        given = sorted(self._object(line, number), key=lambda pair: pair[0])
        if tuple(name for name, _ in given) != self.names:
            surplus = Counter(name for name, _ in given)
            surplus.subtract(self.names)
            odd = next(name for name, count in surplus.items() if count)
            what = "is missing" if surplus[odd] < 0 else "was not in the first object"
            raise _bad(what, number, "send the same keys in every object, and null for no value", odd)
        return [self._number(name, value, number) for name, value in given]

    @staticmethod
    def _object(line: str, number: int) -> Iterable[tuple[str, object]]:
        try:
            pairs = pairs_of(json.loads(line, object_pairs_hook=object_of))
        except (ValueError, RecursionError) as error:
            raise _bad(
                f"this is no JSON ({error})",
                number,
                "send one whole object per line; a stream cut short ends so",
            ) from None
        if pairs is None:
            raise _bad("this is no JSON object", number, 'send objects such as {"t": 0.0, "i_d": 1.0}')
        return pairs

    @staticmethod
    def _number(name: str, value: object, number: int) -> float:
        if value is None:
            return float("nan")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _bad(f"{json.dumps(value)[:40]} is no number", number, "send a number or null", name)
        try:
            return float(value)
        except OverflowError:
            return float("inf")


def _fields(line: str, separator: str, number: int) -> list[str]:
    try:
        return split(line, separator)
    except csv.Error as error:
        raise _bad(f"the quotes cannot be read ({error})", number, "send fields without quotes") from None


def _columns(table: _Table, rows: list[tuple[int, list[float]]], rules: Rules | None, first: int) -> Columns:
    values = np.array([row for _, row in rows], dtype=np.float64).T
    members = [Member(name, unit=unit) for name, unit in zip(table.names, table.units, strict=True)]

    def place(row: int) -> tuple[int, str]:
        return rows[row][0], f"line {rows[row][0]}"

    source = admit(NAME, members, one_by_one(lambda k: values[k]), values.nbytes, place=place)
    return assemble(source, rules, finite=False, first=first)
