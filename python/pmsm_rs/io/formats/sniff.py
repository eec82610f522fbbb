"""Where in a text file the table starts, how it is separated, and what its columns and units are called."""

from __future__ import annotations

import csv
import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from ..._core import DataError
from ...errors import refuse, shown
from ...quantities.units import is_unit

SAMPLE_LINES = 400
_SEPARATORS = (",", ";", "\t", "|", " ")
# No part of these can match the same characters in two ways, so that a long field takes time in proportion.
# Data loggers set the sign apart from the digits.
_NUMBER = re.compile(r"(?:[+-] *)?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?$")
_SIGN_APART = re.compile(r"(?<!\S)([+-])[ \t]+(?=[\d.,])")
_COMMA_NUMBER = re.compile(r"(?:[+-] *)?(\d+,\d*|,\d+)([eE][+-]?\d+)?$")
# Units of what no recording needs.
_OTHER_UNITS = frozenset(
    {"1", "%", "bool", "sample", "samples", "count", "counts", "W", "kW", "mW", "VA", "J", "Wh", "kWh", "Ah"}
    | {"mAh", "Ohm", "H", "mH", "F", "kg", "N", "kN", "gf", "kgf", "m", "mm", "m/s", "km/h", "m/s^2", "m/s2"}
    | {"m/s²", "rad/s^2", "rad/s2", "rad/s²", "bar", "Pa", "kPa", "dB", "T", "Wb"}
)
_ENOUGH_UNITS = 3
_DATE = re.compile(r"\d{1,4}([-/.])\d{1,2}\1\d{1,4}")
_TIME = re.compile(r"\d{1,2}:\d{2}:\d{2}")
_NO_NUMBER = frozenset({"", "nan", "inf", "-inf", "+inf", "null", "na", "n/a"})


class Column(NamedTuple):
    """A column by its header: name, stated unit, and the header as it is written."""

    name: str
    unit: str | None
    header: str


@dataclass(frozen=True)
class Layout:
    """What was found. Lines count from 0; two columns may have one name."""

    separator: str
    comma: bool
    header_line: int
    first_line: int
    columns: tuple[Column, ...]


def skipped(line: str) -> bool:
    """Whether a line is blank or a comment."""
    plain = line.strip()
    return not plain or plain[0] in "#%"


def split(line: str, separator: str) -> list[str]:
    """The fields of one line, without quotes and outer blanks.

    Raises csv.Error on quotes that hold more than a field may.
    """
    if separator == " ":
        return signed(line).split()
    if '"' not in line:
        return [field.strip() for field in line.split(separator)]
    return [field.strip() for field in next(csv.reader([line], delimiter=separator), [])]


def signed(text: str) -> str:
    """`text` with each sign that stands apart from its digits, behind a blank, put before them."""
    return _SIGN_APART.sub(r"\1", text)


def is_number(field: str, comma: bool) -> bool:
    """Whether a field is written as a number, with a decimal comma where `comma`."""
    return bool(_NUMBER.match(field) or (comma and _COMMA_NUMBER.match(field)))


def name_and_unit(field: str) -> tuple[str, str | None]:
    """Name and stated unit of a header field: 'speed [rpm]', 'speed (rpm)', 'C1 in V', 'in s'."""
    if field.rstrip()[-1:] in {"]", ")"}:
        inner = field.rstrip()[:-1]
        behind = max(inner.rfind("]"), inner.rfind(")")) + 1
        opening = min((at for sign in "[(" if (at := inner.find(sign, behind)) >= 0), default=-1)
        if opening >= 0:
            return inner[:opening].strip() or "column", inner[opening + 1 :].strip()
    words = field.rsplit(None, 2)
    if len(words) > 1 and words[-2] == "in" and is_unit(words[-1]):
        return (words[0] if len(words) == 3 else "").strip() or "column", words[-1]
    return field, None


def sniff(lines: list[str], file: str) -> Layout:
    """The layout of a table from its first lines. Raises DataError where there is none, or only a header."""
    rows = {i: line for i, line in enumerate(lines) if not skipped(line)}
    best: tuple[int, int, Layout | None] = (0, 0, None)
    trouble: DataError | None = None
    for separator in _SEPARATORS:
        try:
            found = _with_separator(lines, rows, separator, file)
        except DataError as error:
            trouble = trouble or error
            continue
        if found is not None:
            layout, count = found
            if (count, len(layout.columns)) > best[:2]:
                best = (count, len(layout.columns), layout)
    if best[2] is not None:
        return best[2]
    if trouble is not None:
        raise trouble
    if any(_COMMA_NUMBER.match(field) for line in rows.values() for field in _quoted(line)):
        raise refuse(
            DataError,
            "the numbers are in quotes and hold commas, which may part decimals or thousands",
            file=file,
            fix="export them with a decimal point and without quotes",
        )
    problem = "it has a header but no rows" if 0 < len(rows) < 3 else "no table of numbers was found"
    raise refuse(
        DataError, problem, file=file, fix="export it as CSV with one header line and one sample per line"
    )


def _quoted(line: str) -> list[str]:
    try:
        return [field for field in split(line, ",") if "," in field]
    except csv.Error:
        return []


def _with_separator(
    lines: list[str], rows: dict[int, str], separator: str, file: str
) -> tuple[Layout, int] | None:
    fields = {}
    for i, line in rows.items():
        # A line whose quotes cannot be read is no reason to miss the table around it.
        with suppress(csv.Error):
            fields[i] = split(line, separator)
    comma = separator in ";\t " and _decimal_comma(fields)
    # The table's width is that of the rows made of numbers, which preamble and header are not.
    widths = Counter(
        len(f) for f in fields.values() if sum(is_number(x, comma) for x in f) * 2 >= len(f) and f
    )
    if not widths:
        return None
    width, count = max(widths.items(), key=lambda item: (item[1], item[0]))
    if width < 2 and separator != ",":
        return None
    table = {i: f for i, f in fields.items() if len(f) == width}
    numeric = [
        c
        for c in range(width)
        if 2 * sum(is_number(f[c], comma) for f in table.values()) > len(table)
        or (len(table) <= 4 and is_number(list(table.values())[-1][c], comma))
    ]
    if not numeric:
        return None
    first = next(
        (
            i
            for i, f in table.items()
            if all(is_number(f[c], comma) or f[c].lower() in _NO_NUMBER for c in numeric)
            and any(is_number(f[c], comma) for c in numeric)
        ),
        None,
    )
    if first is None:
        return None
    above = [i for i in fields if i < first]
    header = _header(lines, fields, above, first, width, numeric, comma, separator, file)
    return Layout(separator, comma, header[0], first, _columns(*header[1:])), count


def _decimal_comma(fields: dict[int, list[str]]) -> bool:
    flat = [x for f in fields.values() for x in f]
    commas = sum(bool(_COMMA_NUMBER.match(x)) for x in flat)
    points = sum("." in x and bool(_NUMBER.match(x)) for x in flat)
    return commas > points


def _header(
    lines: list[str],
    fields: dict[int, list[str]],
    above: list[int],
    first: int,
    width: int,
    numeric: list[int],
    comma: bool,
    separator: str,
    file: str,
) -> tuple[int, list[str], list[str] | None]:
    """Line of the header, its fields, and the fields of a units row below it."""
    if above:
        last = above[-1]
        below = fields[last]
        head = fields[above[-2]] if len(above) > 1 else []
        fits = 0 < len(head) <= width and not all(is_number(x, comma) for x in head)
        if fits and _is_units_row(below, head, numeric):
            pad = [""] * (width - len(head))
            return above[-2], head + pad, (below + [""] * width)[:width]
        if separator == " " and len(below) == width - 1 and (k := _stamp(lines[first])) is not None:
            # One name over a date and a time of day, which a blank parts.
            below = [*below[:k], "date", *below[k:]]
        trailing = len(below) == width + 1 and not below[-1]
        if len(below) == width or trailing:
            wrong = next((c for c in numeric if is_number(below[c], comma)), None)
            if wrong is not None and len(numeric) > 1:
                bad = next(c for c in numeric if not is_number(below[c], comma))
                raise refuse(
                    DataError,
                    f"'{shown(below[bad])}' is no number",
                    file=file,
                    row=last + 1,
                    place=f"line {last + 1}",
                    fix="correct or remove the line",
                )
            return last, below[:width], None
        raise refuse(
            DataError,
            f"the header has {len(below)} fields but the rows have {width}",
            file=file,
            row=last + 1,
            place=f"line {last + 1}",
            fix="give each column one name, and use another separator than the decimal comma",
        )
    # A header behind a comment sign, as numpy.savetxt writes it.
    for i in range(first - 1, -1, -1):
        text = lines[i].strip().lstrip("#%").strip()
        named = split(text, separator) if text else []
        if len(named) == width and not any(is_number(x, comma) for x in named):
            return i, named, None
    # Without a header the columns go by their numbers.
    return first - 1, [f"column {c + 1}" for c in range(width)], None


def _stamp(line: str) -> int | None:
    """The field of a line parted by blanks that is a date with a time of day behind it, None without one."""
    pairs = enumerate(pairwise(split(line, " ")))
    return next((k for k, (day, time) in pairs if _DATE.fullmatch(day) and _TIME.match(time)), None)


def _is_units_row(fields: list[str], head: list[str], numeric: list[int]) -> bool:
    """Whether `fields`, below those of `head`, are units."""
    stated = [fields[c].strip("[]() ") for c in numeric if c < len(fields) and fields[c].strip("[]()- ")]
    known = sum(is_unit(x) or x in _OTHER_UNITS for x in stated)
    if not any(map(is_unit, stated)):
        return False
    # Beside units enough, and below a name for every column, what is not known is a unit, too.
    named = len(head) == len(fields) and all(head) and not any(map(is_unit, head))
    return known == len(stated) or (named and known >= _ENOUGH_UNITS and 4 * known >= 3 * len(stated))


def _columns(header: list[str], below: list[str] | None) -> tuple[Column, ...]:
    columns = []
    for c, text in enumerate(header):
        name, unit = name_and_unit(text.strip())
        unit = unit or (below[c].strip("[]() ") if below else None)
        columns.append(Column(name or f"column {c + 1}", unit or None, text.strip()))
    return tuple(columns)
