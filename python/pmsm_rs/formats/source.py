"""What every reader delivers, and what readers of array containers share."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import did_you_mean, refuse

MISSING_FIX = "fill the gap, cut the rows, or leave the column out (NAME = false in [columns])"

_SLICE = re.compile(r"^(?P<name>.+?)\[\s*:\s*,\s*(?P<column>\d+)\s*\]$")


def _row_from_zero(row: int) -> tuple[int, str]:
    return row, f"row {row} (counting from 0)"


@dataclass(frozen=True)
class Source:
    """A recording as it lies in its file or frame: names, stated units, and the way to the numbers.

    `read(names)` gives one 1-D float64 array per name; `place(row)` turns a row (from 0) into the number and
    the words under which the user finds it.
    """

    file: str | None
    names: tuple[str, ...]
    read: Callable[[Iterable[str]], dict[str, NDArray[np.float64]]]
    units: Mapping[str, str] = field(default_factory=dict)
    place: Callable[[int], tuple[int, str]] = _row_from_zero
    resolve: Callable[[str], str | None] = lambda _name: None

    def find(self, wanted: str, canonical: str) -> str:
        """The column called `wanted` here. Raises DataError naming what there is."""
        if wanted in self.names:
            return wanted
        other = self.resolve(wanted)
        if other is not None:
            return other
        raise refuse(
            DataError,
            f"there is no column '{wanted}' for {canonical}",
            file=self.file,
            column=wanted,
            fix=did_you_mean(wanted, self.names),
        )


def numbers(values: object, *, file: str | None, column: str) -> NDArray[np.float64]:
    """`values` as a contiguous 1-D float64 array.

    Raises DataError on text, objects, complex values, other shapes.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        what = {"c": "complex numbers", "M": "dates", "m": "time spans"}.get(
            array.dtype.kind, "no plain numbers"
        )
        fix = "give seconds as numbers" if array.dtype.kind in "Mm" else "store one real number per row"
        raise refuse(DataError, f"it holds {what}", file=file, column=column, fix=fix)
    if array.ndim == 2 and 1 in array.shape:
        array = array.reshape(-1)
    if array.ndim != 1:
        raise refuse(
            DataError,
            f"it has {array.ndim} dimensions {array.shape}",
            file=file,
            column=column,
            fix=f'pick one column of it, as in from = "{column}[:,0]"',
        )
    return np.ascontiguousarray(array, dtype=np.float64)


def from_arrays(
    file: str | None, arrays: Mapping[str, object], shapes: Mapping[str, tuple[int, ...]] | None = None
) -> Source:
    """A source over arrays by name; `NAME[:,3]` picks column 3 (from 0) of a two-dimensional one.

    `shapes` gives the shapes where `arrays` loads lazily.
    """
    known = (
        shapes if shapes is not None else {name: np.asarray(value).shape for name, value in arrays.items()}
    )

    def resolve(name: str) -> str | None:
        part = _SLICE.match(name)
        if part is None or part["name"] not in arrays:
            return None
        shape = known[part["name"]]
        if len(shape) != 2 or int(part["column"]) >= shape[1]:
            raise refuse(
                DataError,
                f"'{part['name']}' has shape {shape}, so it has no column {part['column']}",
                file=file,
                column=name,
                fix="columns count from 0",
            )
        return name

    def read(names: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        out = {}
        for name in names:
            part = _SLICE.match(name) if name not in arrays else None
            values = (
                arrays[name] if part is None else np.asarray(arrays[part["name"]])[:, int(part["column"])]
            )
            out[name] = numbers(values, file=file, column=name)
        return out

    return Source(file, tuple(arrays), read, resolve=resolve)
