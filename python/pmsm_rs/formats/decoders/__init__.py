"""What the decoding process runs, one module per family of formats; the user's process uses none of it.

Each module has a class `Table(file, max_bytes)` with `columns`, a list of descriptions, and `read(wanted)`,
which gives the parts of each column wanted as contiguous float64 arrays. A description holds `path`, `unit`
(None where none is stated), `shape` (None where it is not known before reading), `complex`, `why`, which says
why the column cannot be used (None where it can), and `fix`, what to do then if not to store plain numbers.
Whatever else goes wrong is damage to the file.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..selection import Selection

NUMBER_BYTES = 8

Description = dict[str, Any]
Parts = dict[str, list[NDArray[np.float64]]]


class Refused(Exception):
    """What the file holds cannot be used, for a reason that the user can mend."""

    def __init__(self, problem: str, fix: str, *, column: str | None = None, row: int | None = None) -> None:
        """`row` counts from 0."""
        super().__init__(problem)
        self.problem, self.fix, self.column, self.row = problem, fix, column, row


def describe(
    path: str,
    *,
    unit: str | None = None,
    shape: tuple[int, ...] | None = None,
    complex: bool = False,
    why: str | None = None,
    fix: str | None = None,
) -> Description:
    """One column for the list that the user's process gets."""
    return {
        "path": path,
        "unit": unit or None,
        "shape": list(shape) if shape is not None else None,
        "complex": complex,
        "why": why,
        "fix": fix,
    }


def too_large(size: int, max_bytes: int) -> Refused:
    """The refusal of more than the memory allowed."""
    return Refused(
        f"it unpacks to {size} bytes, more than the {max_bytes} allowed",
        "cut the recording, or raise max_bytes",
    )


def numbers(values: Any, text: str) -> NDArray[np.float64]:
    """What `text` selects of `values`, as contiguous float64."""
    picked = Selection.of(text).pick(np.asarray(values))
    if picked.dtype.kind not in "fiub":
        raise Refused("it holds no plain numbers", "store one real number per row", column=text)
    return np.ascontiguousarray(np.squeeze(picked) if picked.ndim == 2 else picked, dtype="<f8")
