"""Columns of an Arrow stream, taken batch by batch so that memory stays bounded."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import refuse
from .source import MISSING_FIX, Source, numbers

NUMBER_BYTES = 8


def is_number(kind: Any) -> bool:
    """Whether an Arrow data type can become float64 without loss of meaning."""
    types = type(kind)
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind))


def from_reader(
    file: str | None,
    reader: Callable[[], Any],
    max_bytes: int,
    place: Callable[[int], tuple[int, str]] | None = None,
) -> Source:
    """A source over an arro3 RecordBatchReader, opened anew by `reader` for each pass."""
    schema = reader().schema
    names = tuple(str(name) for name in schema.names)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise refuse(
            DataError,
            f"two columns are called '{twice[0]}'",
            file=file,
            column=twice[0],
            fix="rename one of them",
        )
    locate = place or (lambda row: (row, f"row {row} (counting from 0)"))

    def read(wanted: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        chosen = list(wanted)
        for name in chosen:
            kind = schema.field(name).type
            if not is_number(kind) and not type(kind).is_dictionary(kind):
                raise refuse(
                    DataError,
                    f"it holds {kind_name(kind)}, no plain numbers",
                    file=file,
                    column=name,
                    fix="store one real number per row",
                )
        parts: dict[str, list[NDArray[np.float64]]] = {name: [] for name in chosen}
        rows = 0
        for batch in reader():
            for name in chosen:
                column = batch.column(name)
                if column.null_count:
                    first = next(i for i, value in enumerate(column) if value.as_py() is None)
                    row, words = locate(rows + first)
                    raise refuse(
                        DataError,
                        "the value is missing",
                        file=file,
                        row=row,
                        place=words,
                        column=name,
                        fix=MISSING_FIX,
                    )
                parts[name].append(numbers(column.to_numpy(), file=file, column=name))
            rows += batch.num_rows
            if rows * NUMBER_BYTES * max(len(chosen), 1) > max_bytes:
                raise refuse(
                    DataError,
                    f"it needs more than the {max_bytes} bytes of memory allowed",
                    file=file,
                    fix="cut the recording, or raise max_bytes",
                )
        return {name: np.concatenate(chunks) if chunks else np.empty(0) for name, chunks in parts.items()}

    return Source(file, names, read, place=locate)


def kind_name(kind: Any) -> str:
    """The bare name of an Arrow data type."""
    return str(kind).strip().removeprefix("arro3.core.DataType<").removesuffix(">")
