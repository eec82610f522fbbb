"""What every reader delivers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..._core import DataError
from ...errors import did_you_mean, refuse
from ...quantities.units import is_unit
from .remark import Remark
from .selection import Selection
from .sniff import name_and_unit

MISSING_FIX = "fill the gap, cut the rows, or leave the column out (NAME = false in [columns])"
PLAIN_FIX = "store one real number per row"


def row_from_zero(row: int) -> tuple[int, str]:
    """Number and words of row `row`, in formats without lines."""
    return row, f"row {row} (counting from 0)"


class Reads(Protocol):
    """Reads columns by their names."""

    def __call__(self, columns: Iterable[str], gaps: bool = False) -> dict[str, NDArray[np.float64]]:
        """One array of shape (rows,) per name; with `gaps` NaN for missing values in formats that can tell.

        Raises DataError as `Source` says.
        """


@dataclass(frozen=True)
class Source:
    """A recording as it lies in its file or frame: names, stated units, and the way to the numbers.

    `names` has each name once, also where several columns have it. `read(names)` gives one 1-D float64 array
    per name and raises DataError where a name does not settle which column is meant. `place(row)` turns a row
    (from 0) into the number and the words under which the user finds it. `resolve(text)` gives the name for
    whatever else means a column: its path, its header to the letter, a part of an array. `headers` holds
    the headers to the letter where a name is only a part of them, `twice` the names that several columns
    have. `bases` names the time base of each column where the file has several, and `stamps` the sample times
    (s) of each base, by a name that `read` takes. `common` means those of whichever base is used.
    `clocks` are the columns made of dates and times of day, in s, with the columns that each takes in.
    Reading adds to `remarks` what was done to the data.
    """

    file: str | None
    names: tuple[str, ...]
    read: Reads
    units: Mapping[str, str] = field(default_factory=dict)
    place: Callable[[int], tuple[int, str]] = row_from_zero
    resolve: Callable[[str], str | None] = lambda _name: None
    headers: Mapping[str, str] = field(default_factory=dict)
    twice: frozenset[str] = frozenset()
    bases: Mapping[str, str] = field(default_factory=dict)
    stamps: Mapping[str, str] = field(default_factory=dict)
    common: str | None = None
    clocks: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    remarks: list[Remark] = field(default_factory=list)

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
        """The column called `wanted` here, be it without the unit in its name. Raises DataError naming what
        there is.
        """
        if wanted in self.names:
            return wanted
        other = self.resolve(wanted)
        if other is None:
            bare = [name for name in self.names if name_and_unit(name)[0] == wanted]
            other = bare[0] if len(bare) == 1 else None
        if other is not None:
            return other
        raise refuse(
            DataError,
            f"there is no column '{wanted}' for {canonical}",
            file=self.file,
            column=wanted,
            fix=did_you_mean(wanted, self.names),
        )
