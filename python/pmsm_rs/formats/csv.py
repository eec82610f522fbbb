"""Text tables through arro3, behind a sniffer for preambles, units rows, separators and decimal commas."""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import refuse
from . import scope
from .sniff import SAMPLE_LINES, Layout, is_number, skipped, sniff, split
from .source import MISSING_FIX, Source

_BATCH_ROWS = 65_536
_NUMBER_BYTES = 8


def open_file(file: Path, max_bytes: int) -> Source:
    """The columns of a text file. Raises DataError where it is no text or has no table."""
    name = str(file)
    text, axis = scope.uncounted(_text(file.read_bytes(), name))
    head = text[: 1 << 20].split("\n", SAMPLE_LINES)[:SAMPLE_LINES]
    layout = scope.seconds(sniff(head, name))
    lines = text.count("\n") + 1
    if lines * _NUMBER_BYTES > max_bytes:
        raise refuse(
            DataError,
            f"its {lines} lines need more than the {max_bytes} bytes allowed",
            file=name,
            fix="cut the recording, or raise max_bytes",
        )

    def read(wanted: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        chosen = list(wanted)
        if lines * _NUMBER_BYTES * max(len(chosen), 1) > max_bytes:
            raise refuse(
                DataError,
                f"{len(chosen)} columns need more than the {max_bytes} bytes allowed",
                file=name,
                fix="cut the recording, or raise max_bytes",
            )
        return _read(text, layout, chosen, name)

    def place(row: int) -> tuple[int, str]:
        line = _line_of(text, layout, row)
        return line, f"line {line}"

    source = Source(name, layout.names, read, units=layout.units, place=place, headers=layout.headers)
    return source if axis is None else scope.timed(source, axis)


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


def _read(text: str, layout: Layout, wanted: list[str], file: str) -> dict[str, NDArray[np.float64]]:
    import arro3.core as arrow
    import arro3.io

    body = text[_offset(text, layout.first_line) :]
    separator = layout.separator
    if layout.comma:
        body = body.replace(",", ".")
    if separator == " ":
        body = re.sub(r"[ \t]+", " ", re.sub(r"(?m)^[ \t]+|[ \t]+$", "", body))
    elif re.search(rf"[ ]{re.escape(separator)}|{re.escape(separator)}[ ]|^ | $", body, re.MULTILINE):
        body = re.sub(rf" *{re.escape(separator)} *", lambda _: separator, re.sub(r"(?m)^ +| +$", "", body))
    if "%" in body:
        body = re.sub(r"(?m)^\s*%.*\n?", "", body)
    number, words = arrow.DataType.float64(), arrow.DataType.string()
    keys = [f"c{i}" for i in range(len(layout.names))]
    schema = arrow.Schema(
        [
            arrow.Field(k, number if n in wanted else words, nullable=True)
            for k, n in zip(keys, layout.names, strict=True)
        ]
    )
    at = {name: layout.names.index(name) for name in wanted}
    parts: dict[str, list[NDArray[np.float64]]] = {name: [] for name in wanted}
    rows = 0
    try:
        for batch in arro3.io.read_csv(
            io.BytesIO(body.encode()),
            schema,
            has_header=False,
            delimiter=separator,
            comment="#",
            batch_size=_BATCH_ROWS,
        ):
            for name, i in at.items():
                column = batch.column(i)
                if column.null_count:
                    gap = next(r for r, value in enumerate(iter(column)) if value.as_py() is None)
                    line = _line_of(text, layout, rows + gap)
                    raise refuse(
                        DataError,
                        "the value is missing",
                        file=file,
                        row=line,
                        place=f"line {line}",
                        column=name,
                        fix=MISSING_FIX,
                    )
                parts[name].append(np.asarray(column.to_numpy(), dtype=np.float64))
            rows += batch.num_rows
    except DataError:
        raise
    except Exception as error:
        raise _explain(text, layout, wanted, file, error) from error
    return {name: np.concatenate(chunks) if chunks else np.empty(0) for name, chunks in parts.items()}


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


def _explain(text: str, layout: Layout, wanted: list[str], file: str, error: Exception) -> DataError:
    """The error for the first line that arro3 could not take."""
    at = {name: layout.names.index(name) for name in wanted}
    for number, line in enumerate(
        text[_offset(text, layout.first_line) :].split("\n"), start=layout.first_line + 1
    ):
        if skipped(line):
            continue
        fields = split(line, layout.separator)
        if len(fields) != len(layout.names):
            return refuse(
                DataError,
                f"the line has {len(fields)} fields where the header has {len(layout.names)}",
                file=file,
                row=number,
                place=f"line {number}",
                fix="complete or remove the line; a file cut short ends like this",
            )
        for name, i in at.items():
            field = fields[i]
            if (
                field
                and not is_number(field, layout.comma)
                and field.lower() not in {"nan", "inf", "-inf", "+inf"}
            ):
                return refuse(
                    DataError,
                    f"'{field[:40]}' is no number",
                    file=file,
                    row=number,
                    place=f"line {number}",
                    column=name,
                    fix="correct the value or cut the line",
                )
    return refuse(
        DataError,
        f"the table cannot be read ({str(error)[:120]})",
        file=file,
        fix="export it again as plain CSV",
    )
