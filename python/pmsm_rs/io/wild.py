"""Operating points that stand out: rows that the steady voltage equations of all others do not explain.

A steady voltage is linear in resistance, inductance and flux, with an offset. Other physics changes this
line, and changes it for neighbours alike. An outlier lies among the others, and its voltage is far from the
line while theirs are not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .formats.remark import Remark

_FEWEST: Final = 20
"""Fewest rows among which an outlier is looked for."""
_SCATTERS: Final = 10.0
"""Times the scatter of all rows that an outlier is off."""
_ALONE: Final = 3.0
"""Times the farthest of the other rows that an outlier is off."""
_MOST: Final = 0.05
"""Share of rows that may be outliers; one always may."""
_SHOWN: Final = 6
"""Rows that a sentence names."""
_ROUNDS: Final = 40
_ROUNDING: Final = 1e-9
"""Share of the largest voltage below which no scatter is believed."""


def wild_rows(columns: Mapping[str, NDArray[np.float64]]) -> dict[int, tuple[str, float, float]]:
    """The outliers among operating points, whose canonical SI `columns` are of shape (samples,).

    Of each row (from 0) it gives the voltage that is off, by how many V, and how many times the scatter of
    all rows that is.
    """
    speed = columns.get("omega_e", columns.get("omega_m"))
    if speed is None or not {"i_d", "i_q"} <= {*columns}:
        return {}
    found: dict[int, tuple[str, float, float]] = {}
    for name, own, other in (("v_d", "i_d", "i_q"), ("v_q", "i_q", "i_d")):
        if name in columns:
            terms = [columns[own], columns[other], speed, speed * columns[other]]
            for row, (off, times) in _far(columns[name], terms).items():
                found.setdefault(row, (name, off, times))
    return dict(sorted(found.items()))


def told_of(wild: Mapping[int, tuple[str, float, float]], place: Callable[[int], str]) -> Remark:
    """That the outliers `wild` (see `wild_rows`) were left out; `place` gives the words for a row."""
    told = [
        f"{place(row)}, where {name} is {off:+.3g} V off, {times:.2g} times the scatter of all rows"
        for row, (name, off, times) in [*wild.items()][:_SHOWN]
    ]
    more = f"; {len(wild) - _SHOWN} more are like these" if len(wild) > _SHOWN else ""
    one = len(wild) == 1
    return Remark(
        f"{'An outlier was' if one else f'{len(wild)} outliers were'} left out: {'; '.join(told)}{more}.",
        f"The answer does not rest on {'it' if one else 'them'}.",
        "Measure such a point again; it is kept where others near it agree.",
    )


def _far(voltage: NDArray[np.float64], given: list[NDArray[np.float64]]) -> dict[int, tuple[float, float]]:
    rows = len(voltage)
    varied = [values for values in given if np.ptp(values) > 0.0]
    if rows < max(_FEWEST, 4 * (len(varied) + 1)):
        return {}
    off = _residuals(voltage, np.column_stack([np.ones(rows), *varied]))
    size = np.abs(off)
    scatter = 1.4826 * float(np.median(size)) + _ROUNDING * float(np.max(np.abs(voltage)))
    order = np.argsort(size)[::-1]
    most = max(1, int(_MOST * rows))
    count = next((k for k in range(most, 0, -1) if size[order[k - 1]] > _ALONE * size[order[k]]), 0)
    far = order[:count]
    if not count or size[far].min() < _SCATTERS * scatter:
        return {}
    kept = np.delete(np.arange(rows), far)
    among = all(values[kept].min() <= values[row] <= values[kept].max() for values in varied for row in far)
    return {int(row): (float(off[row]), float(size[row] / scatter)) for row in far} if among else {}


def _residuals(voltage: NDArray[np.float64], terms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Residual of `voltage` beside the line of the least sum of distances."""
    terms = terms / np.max(np.abs(terms), axis=0)
    weight = np.ones(len(voltage))
    off = voltage
    least = _ROUNDING * float(np.max(np.abs(voltage))) or 1.0
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(terms * weight[:, None], voltage * weight, rcond=None)[0]
        off = voltage - terms @ found
        weight = 1.0 / np.sqrt(np.maximum(np.abs(off), least))
    return off
