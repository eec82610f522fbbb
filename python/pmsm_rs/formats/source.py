"""What every reader delivers, and what readers of array containers share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .._core import DataError
from ..errors import did_you_mean, refuse
from ..units import is_unit
from .selection import Selection
from .sniff import name_and_unit

MISSING_FIX = "fill the gap, cut the rows, or leave the column out (NAME = false in [columns])"
PLAIN_FIX = "store one real number per row"


def complex_fix(column: str) -> str:
    """How to use a column of complex numbers."""
    return f'take a part of it, as in from = "{column}.real"'


def matrix_fix(column: str) -> str:
    """How to use a matrix."""
    return f'pick one column of it, as in from = "{column}[:,0]", or all its values, "{column}[:]"'


def _row_from_zero(row: int) -> tuple[int, str]:
    return row, f"row {row} (counting from 0)"


def short_names(paths: Collection[str]) -> dict[str, str]:
    """Path -> its last part where no other path ends alike, else the path itself."""
    ends = Counter(path.rsplit("/", 1)[-1] for path in paths)
    return {path: end if ends[end := path.rsplit("/", 1)[-1]] == 1 else path for path in paths}


@dataclass(frozen=True)
class Source:
    """A recording as it lies in its file or frame: names, stated units, and the way to the numbers.

    `read(names)` gives one 1-D float64 array per name; `place(row)` turns a row (from 0) into the number and
    the words under which the user finds it. `headers` are the headers to the letter where a name is only a
    part of it. A name may stand twice: then neither column can be read.
    """

    file: str | None
    names: tuple[str, ...]
    read: Callable[[Iterable[str]], dict[str, NDArray[np.float64]]]
    units: Mapping[str, str] = field(default_factory=dict)
    place: Callable[[int], tuple[int, str]] = _row_from_zero
    resolve: Callable[[str], str | None] = lambda _name: None
    headers: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def twice(self) -> frozenset[str]:
        """Names that more than one column has."""
        return frozenset(name for name, count in Counter(self.names).items() if count > 1)

    @cached_property
    def _by_header(self) -> dict[str, str]:
        """Column by its header to the letter, and by its name without the unit where that is the only one."""
        short = [(name_and_unit(name)[0], name) for name in self.names]
        count = Counter(part for part, _ in short)
        only = {part: name for part, name in short if count[part] == 1}
        return {**only, **{text: name for name, text in self.headers.items()}}

    def header(self, column: str) -> str:
        """The header of `column` to the letter."""
        return self.headers.get(column, column)

    def unit(self, column: str) -> str | None:
        """The unit that the file states for `column` or for the array of which it is a part."""
        stated = self.units.get(column, self.units.get(Selection.of(column).name))
        if stated is None:
            # Formats without a place for units have them in the name.
            stated = name_and_unit(column)[1]
            stated = stated if stated is not None and is_unit(stated) else None
        return stated

    def find(self, wanted: str, canonical: str) -> str:
        """The column called `wanted` here, be it by its name or by its header to the letter. Raises DataError
        naming what there is, and where two columns are called so.
        """
        if wanted in self.twice or (wanted not in self.names and self._by_header.get(wanted) in self.twice):
            raise refuse(
                DataError,
                f"two columns are called '{wanted}'",
                file=self.file,
                column=wanted,
                fix="rename one of them",
            )
        if wanted in self.names:
            return wanted
        other = self.resolve(wanted) or self._by_header.get(wanted)
        if other is not None:
            return other
        raise refuse(
            DataError,
            f"there is no column '{wanted}' for {canonical}",
            file=self.file,
            column=wanted,
            fix=did_you_mean(wanted, {*self.names, *self.headers.values()}),
        )


def numbers(values: object, *, file: str | None, column: str) -> NDArray[np.float64]:
    """`values` as a contiguous and aligned 1-D float64 array.

    Raises DataError on text, objects, complex values, other shapes.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        row = int(np.flatnonzero(np.ma.getmaskarray(values).reshape(-1))[0])
        raise refuse(
            DataError, "the value is masked", file=file, row=row, column=column, fix="cut the row out"
        )
    array = np.asarray(values)
    if array.dtype == np.float64 and array.ndim == 1 and array.flags.c_contiguous and array.flags.aligned:
        return array
    if array.dtype.kind not in "fiub":
        what = {"c": "complex numbers", "M": "dates", "m": "time spans"}.get(
            array.dtype.kind, "no plain numbers"
        )
        fix = (
            "give seconds as numbers"
            if array.dtype.kind in "Mm"
            else complex_fix(column)
            if array.dtype.kind == "c"
            else PLAIN_FIX
        )
        raise refuse(DataError, f"it holds {what}", file=file, column=column, fix=fix)
    if array.ndim == 2 and 1 in array.shape:
        array = array.reshape(-1)
    if array.ndim != 1:
        raise refuse(
            DataError,
            f"it has {array.ndim} dimensions {array.shape}",
            file=file,
            column=column,
            fix=matrix_fix(column),
        )
    # Arrays out of network buffers and packed records need not lie where a float64 must.
    return np.require(array, dtype=np.float64, requirements=["C_CONTIGUOUS", "ALIGNED"])


def from_arrays(
    file: str | None, arrays: Mapping[str, object], shapes: Mapping[str, tuple[int, ...]] | None = None
) -> Source:
    """A source over arrays by name, or by what `Selection` reads as part of one.

    `shapes` gives the shapes where `arrays` loads lazily.
    """
    known = (
        shapes if shapes is not None else {name: np.asarray(value).shape for name, value in arrays.items()}
    )

    def resolve(name: str) -> str | None:
        part = Selection.of(name)
        if part.name not in known:
            return None
        if not part.fits(known[part.name]):
            raise refuse(
                DataError,
                f"'{part.name}' has shape {known[part.name]}, so it has no column {part.column}",
                file=file,
                column=name,
                fix="columns count from 0",
            )
        return name

    def read(names: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        out = {}
        for name in names:
            part = Selection(name) if name in known else Selection.of(name)
            out[name] = numbers(part.pick(np.asanyarray(arrays[part.name])), file=file, column=name)
        return out

    return Source(file, tuple(arrays), read, resolve=resolve)
