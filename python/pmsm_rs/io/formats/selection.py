"""Parts of an array by name.

`NAME[:,3]` is column 3 (from 0) of a matrix, `NAME[:]` all its values row by row, and `.real` or
`.imag` behind either takes a part of complex values.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_SELECTION: Final = re.compile(
    r"^(?P<name>.+?)(?P<index>\[\s*:\s*(,\s*(?P<column>\d{1,9})\s*)?\])?(\.(?P<part>real|imag))?$"
)


@dataclass(frozen=True)
class Selection:
    """Array `name`, its column `column` or all of it flattened, and `part` (real, imag) of complex values."""

    name: str
    column: int | None = None
    flat: bool = False
    part: str | None = None

    @classmethod
    @lru_cache(maxsize=1024)
    def of(cls, text: str) -> Selection:
        """What `text` selects; a plain name selects the array as it is."""
        found = _SELECTION.match(text)
        if found is None:
            return cls(text)
        column = found["column"]
        return cls(
            found["name"],
            int(column) if column is not None else None,
            found["index"] is not None and column is None,
            found["part"],
        )

    def fits(self, shape: tuple[int, ...]) -> bool:
        """Whether an array of `shape` has such a part."""
        return self.column is None or (len(shape) == 2 and self.column < shape[1])

    def pick(self, values: NDArray[Any]) -> NDArray[Any]:
        """The part of `values`."""
        if self.column is not None:
            values = values[:, self.column]
        elif self.flat:
            values = values.reshape(-1)
        if self.part is None:
            return values
        return np.real(values) if self.part == "real" else np.imag(values)
