"""Text tables through arro3, behind a sniffer for preambles, units rows, separators and decimal commas."""

from __future__ import annotations

import codecs
import csv
import io
import re
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..._core import DataError
from ...errors import refuse, shown
from ...mistaken import is_machine_file, no_recording
from . import scope, twincat
from .arrow import with_gaps
from .clock import Clock, Texts, found, seconds
from .gate import admit, few_enough, take, within
from .member import Member, Refused, Wanted
from .remark import Remark
from .sniff import SAMPLE_LINES, Layout, is_number, signed, skipped, sniff, split
from .source import MISSING_FIX, Source

_NUMBER_BYTES: Final = 8
# Fields that are decoded at a time. The decoder reserves room for each of them before it reads the first.
_BATCH_FIELDS: Final = 1 << 20
# What the description of a column takes: 3.6 kB as measured with 400 000 columns.
_COLUMN_BYTES: Final = 4096
# What a clock takes besides its column: dates, times and the fraction of a second, and their sums.
_CLOCK_COLUMNS: Final = 8
# The end of a text, in which some last rows are.
_TAIL_CHARACTERS: Final = 1 << 14
# The sample from which the layout is found: whole lines, as many as fit, and these few however long they are.
_SAMPLE_CHARACTERS: Final = 1 << 20
_FEWEST_LINES: Final = 8
_NO_VALUE: Final = frozenset({"nan", "inf", "-inf", "+inf"})
_BLANKS: Final = r"[^\S\n]"


def open_file(file: Path, max_bytes: int) -> Source:
    """The columns of a text file. Raises DataError where it is no text or has no table."""
    name = str(file)
    content = _text(file.read_bytes(), name)
    if twincat.is_export(content):
        return twincat.open_text(content, name, max_bytes)
    text, axis = scope.uncounted(content)
    try:
        found_layout = sniff(_sample(text), name)
    except DataError as error:
        if is_machine_file(text):
            raise no_recording("a machine file", name) from error
        raise
    layout = scope.seconds(found_layout)
    needed = len(layout.columns) * _COLUMN_BYTES
    try:
        few_enough(len(layout.columns))
        if needed > max_bytes:
            raise Refused(
                f"its {len(layout.columns)} columns need {needed} bytes, more than the {max_bytes} allowed",
                "export fewer columns, or raise max_bytes",
            )
    except Refused as refused:
        raise refuse(DataError, refused.problem, file=name, fix=refused.fix) from refused
    counted = next((k for k, column in enumerate(layout.columns) if axis and column.name == "X"), None)
    if counted is not None:
        layout = scope.timed(layout)
    lines = text.count("\n") + 1
    clocks = found(layout, _rows(text, layout))
    members = [_member(index, layout, clocks) for index in range(len(layout.columns))]
    remarks: list[Remark] = []

    def fetch(wanted: list[Wanted]) -> list[NDArray[np.float64]]:
        used = [clocks[item.index] for item in wanted if item.index in clocks]
        within(lines * _NUMBER_BYTES * (len(wanted) + _CLOCK_COLUMNS * len(used)), max_bytes)
        columns = _read(text, layout, lines, wanted, used, remarks)
        if axis is not None and counted in columns:
            start, step = axis
            columns[counted] = start + step * columns[counted]
        return [take(columns[item.index], item) for item in wanted]

    def place(row: int) -> tuple[int, str]:
        line = _line_of(text, layout, row)
        return line, f"line {line}"

    return admit(name, members, fetch, max_bytes, place=place, remarks=remarks)


def _member(index: int, layout: Layout, clocks: dict[int, Clock]) -> Member:
    """A column as the header declares it; a clock is in s, and its dates are no column by themselves."""
    column = layout.columns[index]
    header = column.header if column.header != column.name else None
    if index in clocks:
        own = (clocks[index].dates, clocks[index].fraction)
        takes_in = tuple(layout.columns[k].name for k in own if k is not None)
        return Member(column.name, unit="s", header=header, takes_in=takes_in)
    main = next((layout.columns[c.column].name for c in clocks.values() if c.dates == index), None)
    why = None if main is None else f"it holds dates, which the sample time '{shown(main)}' takes in"
    fix = None if main is None else f'give t = "{shown(main)}" in [columns]'
    return Member(column.name, unit=column.unit, header=header, why=why, fix=fix)


def _rows(text: str, layout: Layout) -> list[list[str]]:
    """The fields of the first rows and of the last ones."""
    at = _offset(text, layout.first_line)
    head = text[at : at + _SAMPLE_CHARACTERS].split("\n", SAMPLE_LINES)[:-1]
    tail = text[max(at, len(text) - _TAIL_CHARACTERS) :].split("\n")[1:]
    rows = []
    for line in [*head, *tail]:
        if not skipped(line):
            with suppress(csv.Error):
                rows.append(split(line, layout.separator))
    return rows


def _sample(text: str) -> list[str]:
    """The first lines of the text."""
    first = text.split("\n", _FEWEST_LINES)[:_FEWEST_LINES]
    if sum(map(len, first)) >= _SAMPLE_CHARACTERS:
        return first
    lines = text[:_SAMPLE_CHARACTERS].split("\n", SAMPLE_LINES)
    # The last one may be cut, or holds the rest.
    return lines[:-1] if len(lines) > SAMPLE_LINES or len(text) > _SAMPLE_CHARACTERS else lines


def _text(data: bytes, file: str) -> str:
    """The file as text with plain line ends. Raises DataError on bytes that no text file has."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = data.decode("utf-16", errors="replace")
    else:
        if b"\0" in data:
            line = data[: data.index(b"\0")].count(b"\n") + 1
            raise refuse(
                DataError,
                "there is a NUL byte, so this is no text or was damaged",
                file=file,
                row=line,
                place=f"line {line}",
                fix="export it again as text, Parquet or .mat",
            )
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            # Instruments write degree signs and accents in the Western code page.
            text = data.decode("cp1252", errors="replace")
    control = re.search(r"[\x01-\x08\x0e-\x1f]", text)
    if control:
        line = text.count("\n", 0, control.start()) + 1
        raise refuse(
            DataError,
            "there are control characters, so this is no text",
            file=file,
            row=line,
            place=f"line {line}",
            fix="export it as text, Parquet or .mat",
        )
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _read(
    text: str,
    layout: Layout,
    lines: int,
    wanted: list[Wanted],
    clocks: list[Clock],
    remarks: list[Remark],
) -> dict[int, NDArray[np.float64]]:
    """The columns wanted by their index, those of `clocks` in s. Raises Refused naming the first row that
    cannot be read.
    """
    headed = [column.name for column in layout.columns]
    told = {clock.column for clock in clocks}
    names = {item.index: item.column for item in wanted if item.index not in told}
    names |= {clock.fraction: headed[clock.fraction] for clock in clocks if clock.fraction is not None}
    texts = {index: Texts(headed[index], index != clock.column) for clock in clocks for index in clock.texts}
    gaps = any(item.gaps for item in wanted)
    columns = _decoded(text, layout, lines, names, texts, gaps=gaps)
    for clock in clocks:
        fraction = None if clock.fraction is None else columns[clock.fraction]
        columns[clock.column], notes = seconds(clock, texts, fraction, headed)
        remarks += notes
    return columns


def _decoded(
    text: str,
    layout: Layout,
    lines: int,
    names: dict[int, str],
    texts: dict[int, Texts],
    *,
    gaps: bool,
) -> dict[int, NDArray[np.float64]]:
    """The columns `names` by their index, with `gaps` NaN where a value is missing; those of `texts` are
    collected there.
    """
    import arro3.core as arrow
    import arro3.io

    width = len(layout.columns)
    # Fields of the type null are passed over, whatever they hold, and take no room.
    number, words, ignored = arrow.DataType.float64(), arrow.DataType.utf8(), arrow.DataType.null()
    kinds = [number if i in names else words if i in texts else ignored for i in range(width)]
    schema = arrow.Schema([arrow.Field(f"c{i}", kind, nullable=True) for i, kind in enumerate(kinds)])
    parts: dict[int, list[NDArray[np.float64]]] = {i: [] for i in names}
    rows = 0
    try:
        for batch in arro3.io.read_csv(
            io.BytesIO(_plain(text, layout).encode()),
            schema,
            has_header=False,
            delimiter=layout.separator,
            comment="#",
            batch_size=max(1, min(lines, _BATCH_FIELDS // width)),
        ):
            for i, name in names.items():
                column = batch.column(i)
                if column.null_count and gaps:
                    parts[i].append(with_gaps(column))
                    continue
                if column.null_count:
                    gap = next(r for r, value in enumerate(iter(column)) if value.as_py() is None)
                    raise Refused("the value is missing", MISSING_FIX, column=name, row=rows + gap)
                parts[i].append(np.asarray(column.to_numpy(), dtype=np.float64))
            for i, collected in texts.items():
                collected.add([str(text or "") for text in batch.column(i).to_pylist()])
            rows += batch.num_rows
    except Refused:
        raise
    except Exception as error:
        raise _explain(text, layout, names, error) from error
    return {i: np.concatenate(chunks) if chunks else np.empty(0) for i, chunks in parts.items()}


def _plain(text: str, layout: Layout) -> str:
    """The rows with decimal points, and without comments of `%` and blanks around fields.

    Every expression here begins at the start of a line or of a run of blanks, so that it passes over each
    character once.
    """
    body = text[_offset(text, layout.first_line) :]
    separator = layout.separator
    if layout.comma:
        body = body.replace(",", ".")
    if separator == " ":
        body = signed(re.sub(r"[ \t]+", " ", re.sub(r"(?m)^[ \t]+|(?<![ \t])[ \t]+$", "", body)))
    elif " " in body:
        body = re.sub(r"(?<=[+-]) +(?=[\d.])", "", body)
    if separator != " " and " " in body:
        sign = re.escape(separator)
        body = re.sub(rf"(?m)^ +|(?<! ) +$|(?<! ) +(?={sign})|(?<={sign}) +", "", body)
    if "%" in body:
        body = re.sub(rf"(?m)^{_BLANKS}*%.*\n?", "", body)
    return body


def _offset(text: str, line: int) -> int:
    at = 0
    for _ in range(line):
        at = text.index("\n", at) + 1
    return at


def _line_of(text: str, layout: Layout, row: int) -> int:
    """The line (from 1) on which row `row` (from 0) stands; blank lines and comments hold no row."""
    for number, line in enumerate(
        text[_offset(text, layout.first_line) :].split("\n"), start=layout.first_line + 1
    ):
        if not skipped(line):
            if row == 0:
                return number
            row -= 1
    return layout.first_line + 1


def _explain(text: str, layout: Layout, wanted: dict[int, str], error: Exception) -> Refused:
    """The refusal of the first line that arro3 could not take."""
    row = -1
    for line in text[_offset(text, layout.first_line) :].split("\n"):
        if skipped(line):
            continue
        row += 1
        try:
            fields = split(line, layout.separator)
        except csv.Error:
            return Refused(
                "the line has quotes that do not close, or a field that is far too long",
                "correct or remove the line",
                row=row,
            )
        if len(fields) != len(layout.columns):
            return Refused(
                f"the line has {len(fields)} fields where the header has {len(layout.columns)}",
                "complete or remove the line; a file cut short ends like this",
                row=row,
            )
        odd = [
            Refused(
                f"'{shown(fields[i])}' is no number",
                "correct the value or cut the line",
                column=name,
                row=row,
            )
            for i, name in wanted.items()
            if fields[i] and not is_number(fields[i], layout.comma) and fields[i].lower() not in _NO_VALUE
        ]
        if odd:
            odd[0].others = tuple(odd[1:])
            return odd[0]
    return Refused(f"the table cannot be read ({shown(str(error))})", "export it again as plain CSV")
