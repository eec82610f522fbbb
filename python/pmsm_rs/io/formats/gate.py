"""The one gate between the readers and the columns of a recording: names, kinds, parts and sizes.

A reader lists the members of its file and fetches the values of those that are wanted. The rules are the same
for every format:

- A name that two members have is refused where it is wanted, and does not matter otherwise.
- Integers and floating-point numbers are numbers. Booleans, text, dates and objects are not.
- Complex numbers are wanted by their part, `.real` or `.imag`. Real numbers have no imaginary part.
- What the wanted values take in memory is compared with the limit before any of them is unpacked.
- A file has at most `MOST_COLUMNS` columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..._core import DataError, UsageError
from ...errors import refuse, shown
from .directory import Directory
from .member import (
    BOOLEAN,
    COMPLEX,
    DATE,
    DURATION,
    NUMBER,
    NUMBER_BYTES,
    OBJECT,
    TEXT,
    Member,
    Refused,
    Wanted,
    kind_of,
)
from .remark import Remark
from .source import PLAIN_FIX, Source, row_from_zero

_NO_NUMBERS: Final = {
    BOOLEAN: ("it holds true and false, no numbers", "store 1 and 0 as numbers if they are measured values"),
    TEXT: ("it holds text, no numbers", PLAIN_FIX),
    DATE: ("it holds dates, no numbers", "give seconds as numbers"),
    DURATION: ("it holds time spans, no numbers", "give seconds as numbers"),
    OBJECT: ("it holds no plain numbers", PLAIN_FIX),
}

MOST_COLUMNS: Final = 200_000
"""Far more than any recording has. Each takes about a kilobyte, and its name a tenth of a millisecond."""

Fetch = Callable[[list[Wanted]], Sequence[NDArray[np.float64]]]
"""What `take` makes of each member wanted; members come in ascending order of their index."""


def checked_limit(max_bytes: object) -> int:
    """`max_bytes` as a whole number of bytes. Raises UsageError unless it is a number from 0 on."""
    plain = isinstance(max_bytes, int | float | np.integer | np.floating) and not isinstance(max_bytes, bool)
    if not plain or not math.isfinite(max_bytes) or max_bytes < 0:  # type: ignore[arg-type, operator]
        raise refuse(UsageError, f"max_bytes is {max_bytes!r}", fix="give a number of bytes from 0 on")
    return int(max_bytes)  # type: ignore[call-overload, no-any-return]


def few_enough(columns: int, most: int = MOST_COLUMNS) -> None:
    """Raises Refused where there are more than `most` columns."""
    if columns > most:
        raise Refused(f"it has {columns} columns, more than {most}", "export fewer columns")


def within(size: int, max_bytes: int) -> None:
    """Raises Refused where `size` bytes are more than the `max_bytes` allowed."""
    if size > max_bytes:
        raise Refused(
            f"it unpacks to {size} bytes, more than the {max_bytes} allowed",
            "cut the recording, map fewer columns, or raise max_bytes",
        )


def take(values: object, wanted: Wanted) -> NDArray[np.float64]:
    """The part wanted of a member's `values` as a contiguous and aligned float64 array of shape (rows,).

    Raises Refused on values that are masked or no numbers, and on matrices.
    """
    array = np.asanyarray(values)
    column = wanted.column
    _numeric(kind_of(array.dtype), wanted)
    _shaped(array.shape, wanted)
    picked = wanted.part.pick(array).reshape(-1)
    if isinstance(picked, np.ma.MaskedArray):
        masked = np.flatnonzero(np.ma.getmaskarray(picked))
        if masked.size and wanted.gaps:
            picked = np.ma.filled(picked.astype(np.float64), np.nan)
        elif masked.size:
            raise Refused("the value is masked", "cut the row out", column=column, row=int(masked[0]))
    # Arrays out of network buffers and packed records need not lie where a float64 must.
    return np.require(np.asarray(picked), dtype=np.float64, requirements=["C_CONTIGUOUS", "ALIGNED"])


def one_by_one(load: Callable[[int], object]) -> Fetch:
    """A fetch for readers that load one member at a time; no member is loaded twice."""

    def fetch(wanted: list[Wanted]) -> list[NDArray[np.float64]]:
        out, last, values = [], -1, None
        for item in wanted:
            if item.index != last:
                values, last = load(item.index), item.index
            out.append(take(values, item))
        return out

    return fetch


def admit(
    file: str | None,
    members: Sequence[Member],
    fetch: Fetch,
    max_bytes: int,
    *,
    place: Callable[[int], tuple[int, str]] = row_from_zero,
    remarks: list[Remark] | None = None,
) -> Source:
    """The recording whose `members` a reader has found and of which `fetch` gives the values and adds to
    `remarks` what it did to them.

    A member goes by its own name where no other has it, else by GROUP/NAME. Raises DataError where there is
    no member, or far too many; reading raises it on whatever the rules of this module exclude.
    """
    try:
        few_enough(len(members))
    except Refused as refused:
        raise _refusal(refused, file, place) from refused
    if not any(not member.is_note for member in members):
        raise refuse(DataError, "it holds no columns of numbers", file=file, fix=PLAIN_FIX)
    directory = Directory(members)
    named = list(zip(directory.names, members, strict=True))

    def resolve(column: str) -> str | None:
        try:
            found = directory.find(column)
            if found is None:
                return None
            indices, part = found
            if len(indices) == 1 and members[indices[0]].shape is not None:
                _fits(members[indices[0]].shape or (), Wanted(indices[0], column, part))
        except Refused as refused:
            raise _refusal(refused, file, place) from refused
        name = directory.names[indices[0]]
        settled = len(indices) == 1 and directory.is_settled(name)
        return name + column[len(part.name) :] if settled else column

    def read(columns: Iterable[str], gaps: bool = False) -> dict[str, NDArray[np.float64]]:
        try:
            each = (replace(directory.wanted(column), gaps=gaps) for column in columns)
            wanted = sorted(each, key=lambda item: item.index)
            for item in wanted:
                _check(members[item.index], item)
            within(_needed(members, wanted), max_bytes)
            values = fetch(wanted) if wanted else []
        except Refused as refused:
            raise _refusal(refused, file, place) from refused
        return {item.column: part for item, part in zip(wanted, values, strict=True)}

    return Source(
        file,
        directory.listed,
        read,
        directory.units,
        place,
        resolve,
        directory.headers,
        frozenset(name for name in directory.listed if not directory.is_settled(name)),
        {name: member.base for name, member in named if member.base is not None and not member.stamps},
        {member.base: name for name, member in named if member.base is not None and member.stamps},
        next((name for name, member in named if member.stamps and member.base is None), None),
        {name: member.takes_in for name, member in named if member.takes_in is not None},
        [] if remarks is None else remarks,
    )


def _check(member: Member, wanted: Wanted) -> None:
    if member.why is not None:
        raise Refused(member.why, member.fix or PLAIN_FIX, column=wanted.column)
    _numeric(member.kind, wanted)
    if member.shape is not None:
        _shaped(member.shape, wanted)


def _numeric(kind: str, wanted: Wanted) -> None:
    column, part = wanted.column, wanted.part.part
    if kind in _NO_NUMBERS:
        problem, fix = _NO_NUMBERS[kind]
        raise Refused(problem, fix, column=column)
    if kind == COMPLEX and part is None:
        fix = f'take a part of it, as in from = "{shown(column)}.real"'
        raise Refused("it holds complex numbers", fix, column=column)
    if kind == NUMBER and part == "imag":
        raise Refused(
            "it holds real numbers, which have no imaginary part",
            "map the column that has the values, or { value = 0.0 } where they are all zero",
            column=column,
        )


def _fits(shape: tuple[int, ...], wanted: Wanted) -> None:
    part = wanted.part
    if not part.fits(shape):
        raise Refused(
            f"'{shown(part.name)}' has shape {shape}, so it has no column {part.column}",
            "columns count from 0",
            column=wanted.column,
        )


def _shaped(shape: tuple[int, ...], wanted: Wanted) -> None:
    _fits(shape, wanted)
    part, column = wanted.part, shown(wanted.column)
    # Without values it is an empty column, whatever its other dimensions are.
    if part.column is None and not part.flat and 0 not in shape and sum(n != 1 for n in shape) > 1:
        raise Refused(
            f"it has {len(shape)} dimensions {shape}",
            f'pick one column of it, as in from = "{column}[:,0]", or all its values, "{column}[:]"',
            column=wanted.column,
        )


def _needed(members: Sequence[Member], wanted: Sequence[Wanted]) -> int:
    """Bytes that the members wanted unpack to, or the float64 columns made of them, whichever is more."""
    columns = 0
    for item in wanted:
        member = members[item.index]
        if member.shape is not None and not member.held:
            rows = member.shape[0] if item.part.column is not None else math.prod(member.shape)
            columns += NUMBER_BYTES * rows
    whole = sum(members[index].needed for index in {item.index for item in wanted} if not members[index].held)
    return max(columns, whole)


def _refusal(refused: Refused, file: str | None, place: Callable[[int], tuple[int, str]]) -> DataError:
    """The error of a refusal; its `others` are those of other columns in the same row."""
    number, words = (None, None) if refused.row is None else place(refused.row)
    error, *others = [
        refuse(DataError, each.problem, file=file, row=number, place=words, column=each.column, fix=each.fix)
        for each in (refused, *refused.others)
    ]
    error.others = tuple(others)  # type: ignore[attr-defined]
    return error
