"""Dates and times of day in the columns of a text table, as seconds from the first row."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import date
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import shown
from ...quantities.units import UNITS, canonical
from .member import Refused
from .remark import Remark
from .sniff import Layout

_DATE: Final = r"\d{4}([-/.])\d{1,2}\1\d{1,2}|\d{1,2}([-/.])\d{1,2}\2\d{4}|\d{1,2}[- ][A-Za-z]{3}[- ]\d{4}"
_DAYS: Final = re.compile(_DATE)
_TIME: Final = re.compile(
    r"(?:(?P<date>\d[\w./-]*?(?: [A-Za-z]{3} \d{4})?)(?:T|[ \t]+))?"
    r"(\d{1,2}):(\d{2}):(\d{2})(?:[.,:](\d{1,9})\d*)? ?([AaPp][Mm])?(?:Z|([+-]\d{2}):?(\d{2}))?"
)
_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_FRACTIONS: Final = {
    **dict.fromkeys(("millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("nanos", "nanosecond", "nanoseconds"), "ns"),
}
_SECOND: Final = 1_000_000_000
_DAY: Final = 86_400 * _SECOND
_HALF: Final = 12 * 3600 * _SECOND
_MOST: Final = 0.9
"""Share of the texts of a sample from which a column holds what they say; the others are faults."""
_FIX: Final = "correct the value or cut the line"
_ISO: Final = "write dates as 2024-12-31"


class Clock(NamedTuple):
    """A column of times of day, with the columns that belong to it where there are any.

    They hold dates, and the fraction of the second in `unit` (ms, us or ns).
    """

    column: int
    dates: int | None = None
    fraction: int | None = None
    unit: str = "s"

    @property
    def texts(self) -> tuple[int, ...]:
        """Columns of text that are read for it."""
        return (self.column,) if self.dates is None else (self.dates, self.column)


def found(layout: Layout, rows: Sequence[Sequence[str]]) -> dict[int, Clock]:
    """The clocks of a table by their column, as its sample `rows` of fields show."""
    width = len(layout.columns)
    samples = [[row[c] for row in rows if len(row) == width] for c in range(width)]
    times = [c for c in range(width) if _most(_TIME, samples[c])]
    days = [c for c in range(width) if _most(_DAYS, samples[c])]
    out = {}
    for c in times:
        parts = [_TIME.fullmatch(text) for text in samples[c]]
        stamps = [part["date"] for part in parts if part is not None and part["date"]]
        if stamps and not _most(_DAYS, stamps):
            continue
        is_exact = any(part is not None and part[5] for part in parts)
        near = [d for d in (c - 1, c + 1) if d in days] or (days if len(times) == 1 == len(days) else [])
        right = c + 1 + (c + 1 in near[:1])
        unit = None if is_exact or right >= width else _fraction(layout.columns[right].name, samples[right])
        out[c] = Clock(c, near[0] if near and not stamps else None, right if unit else None, unit or "s")
    return out


def _most(pattern: re.Pattern[str], texts: Sequence[str]) -> bool:
    return sum(pattern.fullmatch(text) is not None for text in texts) > _MOST * len(texts)


def _fraction(name: str, samples: Sequence[str]) -> str | None:
    """The unit of a column that is named by a unit alone and stays below a second, else None."""
    unit = _FRACTIONS.get(name.strip().lower()) or canonical(name, "time")
    if unit not in {"ms", "us", "ns"}:
        return None
    most = 1.0 / UNITS["time"][unit].factor
    try:
        return unit if all(0.0 <= float(text) < 0.9999999 * most for text in samples) else None
    except ValueError:
        return None


class Texts:
    """Collects a column of dates or times batch by batch as integers: the number of each different date, and
    the nanoseconds since midnight.
    """

    def __init__(self, column: str, days_only: bool) -> None:
        self.column, self.days_only, self.rows = column, days_only, 0
        self.dates: dict[str, int] = {}
        self.days: list[NDArray[np.int64]] = []
        self.times: list[NDArray[np.int64]] = []

    def add(self, texts: Sequence[str]) -> None:
        """Takes the next batch; a date alone is its midnight. Raises Refused on a text that is neither."""
        days, times = np.full(len(texts), -1, dtype=np.int64), np.zeros(len(texts), dtype=np.int64)
        for k, text in enumerate(texts):
            if text in self.dates:
                days[k] = self.dates[text]
                continue
            part = None if self.days_only else _TIME.fullmatch(text)
            day = part["date"] if part is not None else text if _DAYS.fullmatch(text) else None
            if part is None and day is None:
                what = "date" if self.days_only else "date or time of day"
                problem = f"'{shown(text)}' is no {what}" if text else "the value is missing"
                raise Refused(problem, _FIX, column=self.column, row=self.rows + k)
            if day is not None:
                days[k] = self.dates.setdefault(day, len(self.dates))
            if part is not None:
                times[k] = self._of_day(part, self.rows + k)
        self.rows += len(texts)
        self.days.append(days)
        self.times.append(times)

    def _of_day(self, part: re.Match[str], row: int) -> int:
        hour, minute, second = int(part[2]), int(part[3]), int(part[4])
        if part[6]:
            hour = hour % 12 + (12 if part[6].lower() == "pm" else 0)
        if hour > 23 or minute > 59 or second > 60:
            raise Refused(f"'{shown(part[0])}' is no time of day", _FIX, column=self.column, row=row)
        whole = (60 * hour + minute) * 60 + second
        if part[7]:
            away = 60 * int(part[8])
            whole -= 3600 * int(part[7]) + (away if part[7][0] == "+" else -away)
        return whole * _SECOND + (int(part[5].ljust(9, "0")) if part[5] else 0)


def seconds(
    clock: Clock, texts: Mapping[int, Texts], fraction: NDArray[np.float64] | None, names: Sequence[str]
) -> tuple[NDArray[np.float64], list[Remark]]:
    """The sample times of `clock` in s from the first row, shape (rows,), and what was made of them.

    `names` are those of all columns. Raises Refused on dates that may be read in two ways, and on a fraction
    of a second or more.
    """
    name = names[clock.column]
    times = np.concatenate(texts[clock.column].times or [np.empty(0, dtype=np.int64)])
    dated = texts[clock.column if clock.dates is None else clock.dates]
    if fraction is not None:
        times = times + _nanoseconds(fraction, clock, names)
    remarks = []
    if dated.dates:
        codes = np.concatenate(dated.days)
        if codes.min() < 0:
            row = int(np.argmin(codes))
            raise Refused("there is no date, and other rows have one", _FIX, column=dated.column, row=row)
        times = times + _ordinals(dated, codes, times)[codes] * _DAY
    else:
        back = np.diff(times) < -_HALF
        if back.any():
            times = times + _DAY * np.concatenate([[0], np.cumsum(back)])
            remarks.append(
                Remark(
                    f"The time of day '{shown(name)}' passes midnight, and a day was added there.",
                    "The time goes on over midnight.",
                    "Log the date beside the time of day.",
                )
            )
    parts = [f"'{shown(names[k])}'" for k in (clock.dates, clock.column, clock.fraction) if k is not None]
    joined = " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else parts[0]
    remarks.insert(
        0,
        Remark(
            f"The sample time was taken from {joined}, in seconds from the first row.",
            "Periods and frequencies rest on these stamps.",
            "If they are not those of the samples, give t = { period = ... } (in s) in [columns].",
        ),
    )
    return (times - times[:1]) / _SECOND, remarks


def _nanoseconds(fraction: NDArray[np.float64], clock: Clock, names: Sequence[str]) -> NDArray[np.int64]:
    assert clock.fraction is not None
    scale = UNITS["time"][clock.unit].factor * _SECOND
    wrong = ~((fraction >= 0.0) & (fraction * scale < _SECOND))
    if wrong.any():
        column = names[clock.fraction]
        raise Refused(
            f"{fraction[wrong][0]:g} {clock.unit} is no fraction of the second of "
            f"'{shown(names[clock.column])}'",
            "correct it, or say that it counts by itself, with "
            f't = {{ from = "{shown(column)}", unit = "{clock.unit}" }} in [columns]',
            column=column,
            row=int(np.argmax(wrong)),
        )
    return np.rint(fraction * scale).astype(np.int64)


def _ordinals(dated: Texts, codes: NDArray[np.int64], times: NDArray[np.int64]) -> NDArray[np.int64]:
    """The day number of each different date. Raises Refused where day and month may be exchanged and that
    makes a difference.
    """
    ways = []
    for day_first in (True, False):
        try:
            ways.append(np.array([_day(text, day_first) for text in dated.dates], dtype=np.int64))
        except ValueError:
            continue
    if not ways:
        bad = next(text for text in dated.dates if not _is_day(text))
        row = int(np.argmax(codes == dated.dates[bad]))
        raise Refused(f"'{shown(bad)}' is no date", _FIX, column=dated.column, row=row)
    steps = [np.diff(days[codes]) for days in ways]
    if len(ways) == 1 or np.array_equal(steps[0], steps[1]):
        return ways[0]
    # Only one way is a recording that goes on over midnight.
    passing = [way for way, step in zip(ways, steps, strict=True) if np.all((step == 0) | (step == 1))]
    if len(passing) != 1:
        raise Refused(
            f"the dates from '{shown(next(iter(dated.dates)))}' on may have the day or the month first",
            _ISO,
            column=dated.column,
        )
    return passing[0]


def _is_day(text: str) -> bool:
    for day_first in (True, False):
        try:
            _day(text, day_first)
        except ValueError:
            continue
        return True
    return False


def _day(text: str, day_first: bool) -> int:
    """The number of a day. Raises ValueError where there is no such day."""
    parts = re.split(r"[-/. ]", text)
    if len(parts) != 3:
        raise ValueError(text)
    if len(parts[0]) == 4:
        year, month, day = (int(part) for part in parts)
    elif parts[1].isalpha():
        year, month, day = int(parts[2]), _MONTHS.index(parts[1].lower()) + 1, int(parts[0])
    else:
        year, month, day = int(parts[2]), int(parts[day_first]), int(parts[not day_first])
    # Points part day, month and year in this order only.
    if "." in text and not day_first and len(parts[0]) != 4:
        return _day(text, True)
    return date(year, month, day).toordinal()
