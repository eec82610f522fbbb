"""Numbers out of the traces of a diagnosis: residuals, and their reductions to what a picture can show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Trace = Mapping[str, Array]

_BINS: Final = 420


def channels(trace: Trace) -> list[str]:
    """The channels of a trace, in its order."""
    return [name.removesuffix("_measured") for name in trace if name.endswith("_measured")]


def residual(trace: Trace, name: str, when: str) -> Array:
    """Measured minus model of channel `name`, `when` being "before" or "after", shape (samples,)."""
    return trace[f"{name}_measured"] - trace[f"{name}_{when}"]


def rms(values: Array) -> float:
    """Root of the mean square of the finite values, 0 where there are none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else 0.0


def envelope(x: Array, y: Array, bins: int = _BINS) -> tuple[Array, Array]:
    """x and y thinned to the smallest and largest y of each of `bins` runs of samples, so that no peak is
    lost.
    """
    if len(x) <= 2 * bins:
        return x, y
    rows = -(-len(x) // bins)
    runs = np.full((-(-len(x) // rows), rows), np.nan)
    runs.ravel()[: len(y)] = np.where(np.isfinite(y), y, np.nan)
    empty = np.isnan(runs)
    start = np.arange(len(runs)) * rows
    low = start + np.where(empty, np.inf, runs).argmin(1)
    high = start + np.where(empty, -np.inf, runs).argmax(1)
    some = ~empty.all(1)
    picks = np.unique(np.concatenate([low[some], high[some]]))
    return x[picks], y[picks]


def worst_window(trace: Trace, name: str, share: float = 0.04, fewest: int = 200) -> tuple[int, int]:
    """First and last sample of the stretch, a `share` of the whole, where the residual before is largest
    in rms.
    """
    values = np.nan_to_num(residual(trace, name, "before")) ** 2
    width = min(len(values), max(fewest, int(share * len(values))))
    total = np.concatenate([[0.0], np.cumsum(values)])
    start = int(np.argmax(total[width:] - total[:-width])) if len(total) > width else 0
    return start, start + width


def binned(x: Array, y: Array, bins: int) -> tuple[Array, Array, Array]:
    """Centres, means and rms about the mean of y in `bins` equal bins of x; NaN where a bin is all but
    empty.
    """
    ok = np.isfinite(x) & np.isfinite(y)
    x, y = x[ok], y[ok]
    if not x.size:
        return np.empty(0), np.empty(0), np.empty(0)
    low, high = np.quantile(x, [0.002, 0.998])
    index = np.clip(((x - low) / max(high - low, 1e-300) * bins).astype(int), 0, bins - 1)
    count = np.bincount(index, minlength=bins)
    keep = count >= min(4, max(1, x.size // bins))
    size = np.maximum(count, 1)
    mean = np.bincount(index, y, bins) / size
    square = np.bincount(index, y**2, bins) / size
    centre = low + (np.arange(bins) + 0.5) * (high - low) / bins
    mean[~keep] = np.nan
    return centre, mean, np.sqrt(np.maximum(square - mean**2, 0.0))


def mean_map(x: Array, y: Array, values: Array, cells: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Edges over x and y, and the mean of `values` between them, shape `cells`; NaN where next to nothing is.

    The edges pass over the outermost 0.2 % of the samples.
    """
    ok = np.isfinite(values) & np.isfinite(x) & np.isfinite(y)
    grid = [np.linspace(*_reached(v[ok]), count + 1) for v, count in zip((x, y), cells, strict=True)]
    total, *_ = np.histogram2d(x[ok], y[ok], bins=grid, weights=values[ok])
    count, *_ = np.histogram2d(x[ok], y[ok], bins=grid)
    fewest = min(4, max(1, int(ok.sum()) // 400))
    return grid[0], grid[1], np.where(count < fewest, np.nan, total / np.maximum(count, 1))


def _reached(values: Array) -> tuple[float, float]:
    low, high = (float(bound) for bound in np.quantile(values, [0.002, 0.998])) if values.size else (0.0, 1.0)
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def orders() -> NDArray[np.int_]:
    """The orders that a spectrum shows."""
    return np.arange(1, 15)


def amplitudes(angle: Array, values: Array, at: NDArray[np.int_]) -> Array:
    """Amplitude of `values` at each order `at` of `angle` (rad), every angle weighing the same however fast
    it was passed.
    """
    turn = np.abs(np.gradient(np.unwrap(angle))) if len(angle) > 1 else np.zeros(len(angle))
    ok = np.isfinite(values) & np.isfinite(turn)
    weight = np.where(ok, turn, 0.0)
    total = float(weight.sum())
    if total == 0.0:
        return np.zeros(len(at))
    weighted = weight * np.where(ok, values, 0.0)
    mean = weighted.sum() / total
    centred = weighted - mean * weight
    return np.array([2.0 * abs(np.sum(centred * np.exp(-1j * order * angle))) / total for order in at])


def rated(trace: Trace, noise: Mapping[str, float]) -> list[str]:
    """Channels by how far the residual before stands above the noise, the worst first."""
    return sorted(
        channels(trace), key=lambda name: -rms(residual(trace, name, "before")) / (noise.get(name) or 1.0)
    )


def elapsed(trace: Trace) -> Array:
    """The time of a trace (s), in which recordings that lie end to end follow one another."""
    t = trace["t"]
    steps = np.diff(t)
    back = steps <= 0.0
    if not back.any():
        return t
    # A recording begins one usual step after the one before it ends.
    usual = float(np.median(steps[~back])) if not back.all() else 1.0
    return np.asarray(t[0] + np.concatenate([[0.0], np.cumsum(np.where(back, usual, steps))]))


def autocorrelation(values: Array, lags: int) -> Array:
    """Correlation of a residual with itself at lags of 0 to `lags` samples, shape (lags + 1,).

    What is not finite counts as nothing. Zero where there is nothing at all.
    """
    ok = np.isfinite(values)
    x = np.where(ok, values - (values[ok].mean() if ok.any() else 0.0), 0.0)
    power = float(x @ x)
    if power <= 0.0:
        return np.zeros(lags + 1)
    # From the spectrum, with zeros behind the residual: a product for each lag takes longer than all else in
    # a report.
    size = 1 << (x.size + lags).bit_length()
    spectrum = np.abs(np.fft.rfft(x, size)) ** 2
    return np.asarray(np.fft.irfft(spectrum, size)[: lags + 1] / power)


def density(values: Array, scale: float, reach: float, bins: int) -> tuple[Array, Array]:
    """Centres and density of `values / scale` in `bins` equal bins from -reach to reach; what lies beyond
    counts as part of the whole.
    """
    finite = values[np.isfinite(values)] / scale
    edges = np.linspace(-reach, reach, bins + 1)
    count, _ = np.histogram(finite, edges)
    return (edges[1:] + edges[:-1]) / 2.0, count / (max(finite.size, 1) * (edges[1] - edges[0]))
