"""The columns of a file as numbers: what each is taken for, its range, its gaps and its course."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import Problem, fact, refuse
from ..quantities.units import canonical, dimension_of
from .formats.selection import Selection
from .formats.source import Source
from .naming import meaning
from .planning import Survey
from .reading import Account, Unused

STRETCHES: Final = 20
"""Parts of a column whose highest values show its course."""
_TOGETHER: Final = 64
"""Columns that are read at a time: a file may have thousands."""
_READS: Final = 16
"""Times that a file is read over for its columns, at least as many as make groups of `_TOGETHER`."""
_VALUES: Final = 1 << 20
"""Values that are read at a time, where that is more columns: short columns take next to no memory."""
_FAULTS: Final = 64
"""Rows with columns that cannot be read, each of which has the others read over, before the rest is passed
over."""
_FIELDS: Final = 1 << 19
"""Fields of a row that are read over in all, where that is fewer times: each of them takes time."""
UNNAMED: Final = "nothing in the name says that it is a signal of the motor"
"""Why a column is not used whose name says nothing."""


@dataclass(frozen=True)
class Signal:
    """One column of a file.

    `names` are the canonical columns that it is taken for, none where it is not used, and `how` it was
    recognised. `low`, `high` and `course` are in `unit`, which is None where neither file nor name states it;
    all of them are over the values that are finite. `course` has the highest value of each of at most
    STRETCHES parts, NaN for a part without one. `missing` of `rows` values are not there, the first of them
    at `first_missing`, in words. `why` says why it is not used or cannot be read. `use` are the lines of
    [columns] of which one would use it. `could_be` are the canonical columns that it could be where there are
    several. `base` is the time base of a column in a file that has several.
    """

    column: str
    names: tuple[str, ...]
    how: str | None
    unit: str | None
    rows: int
    missing: int
    first_missing: str | None
    low: float | None
    high: float | None
    course: tuple[float, ...]
    why: str | None
    use: tuple[str, ...]
    could_be: tuple[str, ...]
    base: str | None

    @property
    def is_empty(self) -> bool:
        """Whether every value is missing."""
        return 0 < self.rows == self.missing


def as_read(signal: Signal, account: Account, source: Source) -> Signal:
    """A column as the recording has it, which may have left out what its name or [columns] says."""
    names = tuple(name for name in signal.names if name in account.columns)
    if names == signal.names:
        return signal
    header = source.header(signal.column)
    why = next((entry.why for entry in account.unused if entry.column == header), signal.why)
    return replace(signal, names=names, how=signal.how if names else None, why=why)


def signals(source: Source, survey: Survey) -> tuple[list[Signal], dict[str, NDArray[np.float64]]]:
    """Every column of `source` in its order, and the raw values of those that are taken or could be, by
    their names there, each of shape (rows,).
    """
    taken: dict[str, list[str]] = {}
    for name, rule in survey.plan.items():
        if rule.source is not None:
            taken.setdefault(rule.source, []).append(name)
    columns = _columns(source, taken)
    raw: dict[str, NDArray[np.float64]] = {}
    found: dict[str, Signal] = {}
    # What is used is read by itself, so that it can be read where all columns together take too much memory.
    rest = [column for column in columns if column not in taken and column != source.common]
    group = [column for column in columns if column in taken and column != source.common]
    group, rest = (group, rest) if group else (rest[:_TOGETHER], rest[_TOGETHER:])
    least = max(_TOGETHER, -(-len(rest) // _READS))
    fates = _Fates(source, survey)
    tries, rows = iter(range(min(_FAULTS, _FIELDS // max(len(columns), 1)))), 0
    while group:
        for column, own in _values(source, group, tries):
            found[column] = _signal(column, own, taken.get(column, []), fates)
            if isinstance(own, DataError):
                continue
            rows = max(rows, len(own))
            if column in taken or found[column].use:
                raw[column] = own
        size = max(least, _VALUES // rows) if rows else least
        group, rest = rest[:size], rest[size:]
    if source.common in columns:
        # The times that stand for those of any group have no values of their own.
        nothing: NDArray[np.float64] = np.empty(0)
        found[source.common] = _signal(source.common, nothing, taken.get(source.common, []), fates)
    return [found[column] for column in columns], raw


def _columns(source: Source, taken: Iterable[str]) -> list[str]:
    """The names of all columns; an array of which parts are taken counts as these."""
    parts: dict[str, list[str]] = {}
    for column in taken:
        if column not in source.names:
            parts.setdefault(Selection.of(column).name, []).append(column)
    listed = [part for name in source.names for part in parts.pop(name, [name])]
    rest = [column for columns in parts.values() for column in columns if column != source.common]
    return [*dict.fromkeys([*listed, *rest])]


def _values(
    source: Source, columns: Sequence[str], tries: Iterator[int]
) -> Iterator[tuple[str, NDArray[np.float64] | DataError]]:
    """The values of each column, or why they cannot be read; a fault takes one of the `tries`, and behind the
    last one no more is read.
    """
    left = dict.fromkeys(columns)
    while left:
        try:
            yield from source.read(left, gaps=True).items()
            return
        except DataError as error:
            others = fact(error, "others")
            same = others if isinstance(others, tuple) else ()
            told = {fact(each, "column"): each for each in (error, *same)}
            if fact(error, "column") not in left:
                # The fault is that of the table, and of each of its columns.
                yield from ((column, error) for column in left)
                return
            for column in [column for column in left if column in told]:
                del left[column]
                yield column, told[column]
            if left and next(tries, None) is None:
                passed = refuse(
                    DataError,
                    "it was passed over, as too many other columns cannot be read",
                    file=source.file,
                    fix="export columns of numbers alone",
                )
                yield from ((column, passed) for column in left)
                return


def _signal(
    column: str,
    values: NDArray[np.float64] | DataError,
    names: list[str],
    fates: _Fates,
) -> Signal:
    source, survey = fates.source, fates.survey
    header = source.header(column)
    rule = survey.plan[names[0]] if names else None
    why, use = (None, ()) if names else fates.of(column)
    unit = _stated(column, source) if rule is None else rule.unit
    if isinstance(values, DataError):
        place, fix = fact(values, "place"), "" if names else f"; {fact(values, 'fix')}"
        told = f"{fact(values, 'problem')}{f' ({place})' if place else ''}{fix}"
        why = told if names or why in {None, UNNAMED} else why
        values = np.empty(0)
    elif rule is not None:
        values = values * rule.scale + rule.offset
    gaps = np.flatnonzero(np.isnan(values))
    finite = values[np.isfinite(values)]
    return Signal(
        header,
        tuple(names),
        survey.how[names[0]] if names else None,
        unit,
        len(values),
        len(gaps),
        source.place(int(gaps[0]))[1] if len(gaps) else None,
        float(finite.min()) if finite.size else None,
        float(finite.max()) if finite.size else None,
        course(values),
        why,
        use,
        fates.unused[header].could_be if header in fates.unused else (),
        source.bases.get(column) if len(source.stamps) > 1 else None,
    )


def _stated(column: str, source: Source) -> str | None:
    """The unit of a column that is not taken, as far as it is one."""
    found = meaning(column, source.unit(column))
    text = source.unit(column) or (found.unit if found is not None else None)
    dimension = None if text is None else dimension_of(text)
    return text if dimension is None or text is None else canonical(text, dimension)


class _Fates:
    """What `survey` says of the columns of `source` that are not used, found by their names and headers."""

    def __init__(self, source: Source, survey: Survey) -> None:
        self.source, self.survey = source, survey
        self.problems: dict[str | None, Problem] = {}
        for problem in survey.problems:
            if problem.lines:
                self.problems.setdefault(problem.column, problem)
        self.unused: dict[str, Unused] = {}
        for entry in survey.account.unused:
            self.unused.setdefault(entry.column, entry)
        self.clocks = {part: clock for clock, parts in reversed([*source.clocks.items()]) for part in parts}
        self.stamps = frozenset(source.stamps.values())

    def of(self, column: str) -> tuple[str, tuple[str, ...]]:
        """Why a column is not used, and the lines of [columns] of which one would use it."""
        header = self.source.header(column)
        problem = self.problems.get(column) or self.problems.get(header)
        if problem is not None:
            return problem.problem, problem.lines
        entry = self.unused.get(header)
        if entry is not None:
            return entry.why, () if entry.use is None else (entry.use,)
        if column in self.clocks:
            return f"it is a part of the sample time '{self.source.header(self.clocks[column])}'", ()
        if column in self.stamps:
            return "it holds the sample times of its group", ()
        return UNNAMED, ()


def course(values: NDArray[np.float64]) -> tuple[float, ...]:
    """The highest finite value of each of at most STRETCHES equal parts of `values`, shape (rows,); NaN where
    a part has none.
    """
    if not values.size:
        return ()
    known = np.where(np.isfinite(values), values, -np.inf)
    highest = np.maximum.reduceat(known, _starts(len(values)))
    return tuple(float(value) if value > -np.inf else float("nan") for value in highest)


@lru_cache(maxsize=8)
def _starts(rows: int) -> NDArray[np.intp]:
    """Where each of at most STRETCHES equal parts of so many rows begins, shape (parts,)."""
    return np.linspace(0, rows, min(STRETCHES, rows) + 1).astype(np.intp)[:-1]
