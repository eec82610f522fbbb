"""Clocks that are not what they seem: counters that wrap, and stamps that several rows share.

All arrays are of shape (rows,), and times are in the unit of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import shown
from .formats.remark import Remark

_BITS: Final = (16, 24, 31, 32)
"""Lengths of counters."""
_SCALES: Final = (1.0, 1e-3, 1e-6, 1e-9)
"""Units of the file per count: it may hold ms or s of a counter of µs."""
_LONGEST: Final = 3.0
"""Typical steps that may pass at a wrap; a longer one may be another fault."""
_SHARED: Final = 0.1
"""Share of rows with the stamp of the row before, from which a clock is coarse and no row a repeated one."""
_REPEATED: Final = 0.9
"""Share of these rows that are the row before in every column: then rows are repeated."""
_FEWEST: Final = 3
"""Steps of a coarse clock that tell its rate."""
_EVEN: Final = 1.05
"""Steps of a coarse clock within which evenly spaced rows must lie."""

Place = Callable[[int], tuple[int, str]]


def unwrapped(
    stamps: NDArray[np.float64], column: str, place: Place
) -> tuple[NDArray[np.float64], Remark | None]:
    """Stamps of a counter with its range added behind each place where it wraps, and what to say of it.

    Each jump back must lead to the next count as if the counter had gone on; otherwise the stamps come back
    as they are, with None.
    """
    steps = np.diff(stamps)
    back = np.flatnonzero(steps < 0.0)
    forward = steps[steps > 0.0]
    if not back.size or not forward.size or not np.isfinite(stamps).all():
        return stamps, None
    typical = float(np.median(forward))
    for bits in _BITS:
        for scale in _SCALES:
            whole = 2.0**bits * scale
            after = steps[back] + whole
            if typical < whole / 4.0 and np.all((after >= 0.0) & (after <= _LONGEST * typical)):
                wraps = np.zeros(len(stamps))
                wraps[back + 1] = whole
                return stamps + np.cumsum(wraps), _wrapped(column, bits, scale, back, place)
    return stamps, None


def _wrapped(column: str, bits: int, scale: float, back: NDArray[np.int64], place: Place) -> Remark:
    times = "once" if len(back) == 1 else f"{len(back)} times"
    first = "at" if len(back) == 1 else "first at"
    counts = f"2^{bits} counts" + ("" if scale == 1.0 else f" of {scale:g}")
    return Remark(
        f"The clock '{shown(column)}' wraps {times} at {counts}, {first} {place(int(back[0]) + 1)[1]}, and "
        "was continued there.",
        "The time goes on as if the counter had no end.",
        "If the rows are of two recordings, cut them apart.",
    )


def spread(
    stamps: NDArray[np.float64], others: Iterable[NDArray[np.float64]], column: str, unit: str
) -> tuple[NDArray[np.float64], Remark | None]:
    """Stamps of a coarse clock, which several rows share, spread over the time to the next stamp; and what
    is to be said of it.

    Rows are evenly spaced over the whole recording where that agrees with every stamp, else between each
    stamp and the next. Stamps that run back, of repeated rows, or too few to tell a rate come back as they
    are, with None. `others` are the other columns.
    """
    if len(stamps) <= _FEWEST:
        return stamps, None
    steps = np.diff(stamps)
    same = steps == 0.0
    starts = np.flatnonzero(~same) + 1
    if not same.mean() >= _SHARED or not np.all(steps >= 0.0) or len(starts) < _FEWEST:
        return stamps, None
    alike = same.copy()
    for values in others:
        if len(values) == len(stamps):
            alike &= values[1:] == values[:-1]
    if alike.sum() > _REPEATED * same.sum():
        return stamps, None
    each = float(starts[-1] - starts[0]) / (len(starts) - 1)
    quantum = float(np.median(steps[starts - 1]))
    rows = np.arange(len(stamps), dtype=np.float64)
    period = np.polyfit(rows[starts], stamps[starts] - stamps[0], 1)[0]
    late = stamps - stamps[0] - period * rows
    if np.ptp(late) <= _EVEN * quantum:
        return stamps[0] + period * rows, _shared(column, unit, each, period, "")
    # The first stamp may have begun before the recording, the last one goes on behind it, and a gap is none
    # of the rows before it.
    counts = np.diff(starts, append=len(stamps))
    gaps = np.diff(stamps[starts], append=np.inf)
    usual = float(np.median(quantum / counts))
    apart = np.where(gaps > _LONGEST * quantum, usual, gaps / counts)
    inner = stamps[starts].repeat(counts) + apart.repeat(counts) * (rows[starts[0] :] - starts.repeat(counts))
    out = np.concatenate([stamps[starts[0]] - usual * np.arange(starts[0], 0, -1), inner])
    between = " between one stamp and the next"
    return out, _shared(column, unit, each, float(np.median(np.diff(out))), between)


def _shared(column: str, unit: str, each: float, period: float, where: str) -> Remark:
    return Remark(
        f"{each:.3g} rows share each stamp of '{shown(column)}', and were spaced evenly{where}, "
        f"{period:.6g} {unit} apart.",
        "Jitter of the sampling that is finer than the stamps is not seen.",
        "Log the time with more digits, or give t = { period = ... } in [columns].",
    )
