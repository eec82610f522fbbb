"""The data behind the time plots of the report, small enough to lie within the page for its script."""

from __future__ import annotations

import base64
from typing import Any, Final

import numpy as np

from ..results import traces
from ..results.findings import DiagnosisValues
from ..results.traces import Array
from ..results.words import channel

POINTS: Final = 8192
"""Values that are kept of each signal; of longer ones the smallest and the largest of equal runs of rows."""
_LEVELS: Final = 32767
_NOTHING: Final = -32768
"""Stands where a value is not finite."""


def packed(answer: DiagnosisValues) -> dict[str, Any] | None:
    """The traces that are drawn, None without any.

    They are `t` (s since `start`), and the signals of every channel as whole numbers of two bytes. `paired`
    says whether each two values are the ends of a run of rows.
    """
    if answer.shown is None:
        return None
    trace = answer.traces[answer.shown]
    t = traces.elapsed(trace)
    rows = _rows(len(t))
    start = float(t[0])
    shown = t if rows == 1 else _times(t, rows)
    return {
        "start": start,
        "t": _text((shown - start).astype("<f4")),
        "paired": rows > 1,
        "channels": {name: _channel(answer, trace, name, rows) for name in traces.channels(trace)},
    }


def _rows(count: int) -> int:
    """Rows of which the smallest and the largest are kept; one where all are."""
    return 1 if count <= POINTS else -(-2 * count // POINTS)


def _channel(answer: DiagnosisValues, trace: traces.Trace, name: str, rows: int) -> dict[str, Any]:
    symbol, unit = channel(name)
    signals = {part: trace[f"{name}_{part}"] for part in ("measured", "before", "after")}
    signals |= {f"residual_{when}": traces.residual(trace, name, when) for when in ("before", "after")}
    return {
        "symbol": symbol,
        "unit": unit,
        "noise": answer.noise_floor.get(name),
        "signals": {part: _levels(ends(values, rows)) for part, values in signals.items()},
    }


def ends(values: Array, rows: int) -> Array:
    """The smallest and the largest finite value of every `rows` values, in the order in which they come."""
    if rows == 1:
        return values
    whole = np.full(-(-len(values) // rows) * rows, np.nan)
    whole[: len(values)] = np.where(np.isfinite(values), values, np.nan)
    runs = whole.reshape(-1, rows)
    low, high = np.fmin.reduce(runs, axis=1), np.fmax.reduce(runs, axis=1)
    rising = np.where(np.isnan(runs), np.inf, runs).argmin(1) <= np.where(
        np.isnan(runs), -np.inf, runs
    ).argmax(1)
    first, second = np.where(rising, low, high), np.where(rising, high, low)
    return np.asarray(np.column_stack([first, second]).ravel(), dtype=float)


def _times(t: Array, rows: int) -> Array:
    """Times of both ends of every run: a quarter and three quarters into it."""
    first = np.arange(0, len(t), rows)
    size = np.minimum(first + rows, len(t)) - first
    quarters = np.column_stack([first + size // 4, first + (3 * size) // 4]).ravel()
    return np.asarray(t[quarters], dtype=float)


def _levels(values: Array) -> dict[str, Any]:
    """Values as whole numbers from -32767 to 32767: value = middle + number · step."""
    ok = np.isfinite(values)
    low, high = (float(values[ok].min()), float(values[ok].max())) if ok.any() else (0.0, 0.0)
    middle, step = (low + high) / 2.0, (high - low) / (2.0 * _LEVELS) or 1.0
    whole = np.where(ok, np.round((np.where(ok, values, middle) - middle) / step), _NOTHING)
    return {"middle": middle, "step": step, "data": _text(whole.astype("<i2"))}


def _text(values: np.ndarray[Any, np.dtype[Any]]) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
