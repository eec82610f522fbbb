"""Columns that are held between updates: a sensor that is read less often than rows are written."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import shown
from ..results.words import listed
from .formats.remark import Remark

_SENSED: Final = frozenset(
    {"i_a", "i_b", "i_c", "i_d", "i_q", "theta_e", "theta_m", "omega_e", "omega_m", "tau_e", "tau_m"}
)
_FEWEST: Final = 32
"""Fewest updates from which something is said of a column."""
_NEW: Final = 0.5
"""Share of rows with a new value below which a column is held, or coarse."""
_COARSE: Final = 2.5
"""Steps of the scale up to which a change is that of a coarse sensor."""
_LARGE: Final = 0.25
"""Share of larger changes from which it is held: a coarse sensor keeps its value, then moves by a step."""
_REGULAR: Final = 0.8
"""Share of updates of one length that are regular: those of a coarse sensor follow the motion."""
_UNEQUAL: Final = 1.2
"""Ratio of large to small changes that are no steps of one size."""
_SAME: Final = 1e-9
"""Share of the range within which values are the same."""


def held(columns: Mapping[str, NDArray[np.float64]], headers: Mapping[str, str]) -> Remark | None:
    """What is to be said of the canonical `columns`, each of shape (samples,), that are held between updates;
    None where none is. `headers` has their names in the file.
    """
    found = {name: each for name in columns if name in _SENSED and (each := _rows_per_update(columns[name]))}
    if not found:
        return None
    names = listed([f"'{shown(headers.get(name, name))}'" for name in found])
    rows = listed([f"{each:.2g}" for each in found.values()])
    one = len(found) == 1
    return Remark(
        f"{names} {'keeps its value' if one else 'keep their values'} for {rows} rows on average, and "
        f"{'is' if one else 'are'} held between updates.",
        "What happens between two updates is not seen, and their jumps may pass for noise or delay.",
        "Log each sensor at its own rate, or write a row only where there are new values.",
    )


def _rows_per_update(values: NDArray[np.float64]) -> float | None:
    """Rows per new value from the first change to the last one, None where the column is not held."""
    steps = np.abs(np.diff(values))
    changes = np.flatnonzero(steps)
    if len(changes) < _FEWEST:
        return None
    span = int(changes[-1] - changes[0])
    if len(changes) > _NEW * span:
        return None
    sizes = steps[changes]
    between = np.diff(np.unique(values))
    step = float(np.median(between[between > _SAME * np.ptp(values)]))
    jumps = np.mean(sizes > _COARSE * step) >= _LARGE
    lengths = np.diff(changes)
    regular = np.bincount(lengths).max() >= _REGULAR * len(lengths)
    small, large = np.quantile(sizes, [0.1, 0.9])
    return span / len(lengths) if jumps or (regular and large > _UNEQUAL * small) else None
