"""Text exports of TwinCAT Scope: blocks of columns, each with its own times in front, and rows of properties.

A block begins where a row of properties has its own name instead of a value; there stand the times in ms. A
block with fewer samples ends in earlier rows than others. Scale and offset are in the values already.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import shown
from .gate import admit, take, within
from .member import BOOLEAN, NUMBER, NUMBER_BYTES, Member, Refused, Wanted
from .sniff import is_number
from .source import Source

TIME: Final = "time"
_HEAD: Final = re.compile(r"Name([\t;,|])")
_START: Final = re.compile(r"(?m)^Starttime of export[\t;,|]")
_HEAD_CHARACTERS: Final = 1 << 16
_END: Final = "EOF"
_TRUTH: Final = frozenset({"BIT", "BOOL", "BOOLEAN"})
_NO_TIME: Final = "no channel with a sample time is wanted"
_NO_TIME_FIX: Final = "map at least one channel"
_FIX: Final = "export it again from TwinCAT Scope"


class _Layout(NamedTuple):
    """Separator, decimal comma, properties by their name with one field per column, and the lines (from 0) of
    the first sample and behind the last.
    """

    separator: str
    comma: bool
    properties: dict[str, list[str]]
    first: int
    end: int


def is_export(text: str) -> bool:
    """Whether a text is such an export."""
    return _HEAD.match(text) is not None and _START.search(text[:_HEAD_CHARACTERS]) is not None


def open_text(text: str, name: str, max_bytes: int) -> Source:
    """The channels of the export `name`, of which `text` is the content. Raises DataError where it has
    none.
    """
    lines = text.split("\n")
    layout = _layout(lines)
    places, members = _members(layout)

    def fetch(wanted: list[Wanted]) -> list[NDArray[np.float64]]:
        within((layout.end - layout.first) * NUMBER_BYTES * len(wanted), max_bytes)
        return [take(_column(lines, layout, places[item.index], item), item) for item in wanted]

    def place(row: int) -> tuple[int, str]:
        return layout.first + row + 1, f"line {layout.first + row + 1}"

    return admit(name, members, fetch, max_bytes, place=place)


def _layout(lines: list[str]) -> _Layout:
    """The parts of an export."""
    head = _HEAD.match(lines[0])
    assert head is not None
    separator = head[1]
    at = next((k for k, line in enumerate(lines) if k and line.startswith(f"Name{separator}")), len(lines))
    properties: dict[str, list[str]] = {}
    while at < len(lines) and lines[at].strip():
        fields = [field.strip().strip('"') for field in lines[at].split(separator)]
        if is_number(fields[0], True):
            break
        properties[fields[0]] = fields
        at += 1
    while at < len(lines) and not lines[at].strip():
        at += 1
    end = len(lines)
    while end > at and lines[end - 1].strip() in {"", _END}:
        end -= 1
    comma = separator != "," and any("," in line for line in lines[at:end])
    return _Layout(separator, comma, properties, at, end)


def _members(layout: _Layout) -> tuple[list[int], list[Member]]:
    """The columns by their place in a row, and the times of each block."""
    properties = layout.properties
    names = properties.get("Name", [])
    places: list[int] = []
    members: list[Member] = []
    base = None
    for c, name in enumerate(names):
        if all(c < len(fields) and fields[c] == key for key, fields in properties.items()):
            base = str(c + 1)
            member = Member(TIME, base, unit="ms", base=base, stamps=True)
        elif name:
            kind = BOOLEAN if _property(properties, "Data-Type", c) in _TRUTH else NUMBER
            member = Member(name, kind=kind, unit=_unit(_property(properties, "Unit", c)), base=base)
        else:
            continue
        places.append(c)
        members.append(member)
    if members:
        places.append(0)
        members.append(Member(TIME, unit="s", stamps=True, why=_NO_TIME, fix=_NO_TIME_FIX))
    return places, members


def _property(properties: dict[str, list[str]], key: str, column: int) -> str:
    fields = properties.get(key, [])
    return fields[column] if column < len(fields) else ""


def _unit(text: str) -> str | None:
    """The unit in `V (Voltage)`; `(None)` is none."""
    return text.partition("(")[0].strip() or None


def _column(lines: list[str], layout: _Layout, place: int, item: Wanted) -> NDArray[np.float64]:
    """The values of a column as far as its block goes. Raises Refused on a field that is no number."""
    fields = _fields(lines, layout, place)
    values = []
    for row, field in enumerate(fields):
        if not field:
            break
        try:
            values.append(float(field.replace(",", ".") if layout.comma else field))
        except ValueError:
            problem = f"'{shown(field)}' is no number"
            raise Refused(problem, _FIX, column=item.column, row=row) from None
    if any(fields):
        raise Refused("the value is missing", _FIX, column=item.column, row=len(values))
    return np.array(values, dtype=np.float64)


def _fields(lines: list[str], layout: _Layout, place: int) -> Iterator[str]:
    for line in lines[layout.first : layout.end]:
        fields = line.split(layout.separator, place + 1)
        yield fields[place].strip() if place < len(fields) else ""
