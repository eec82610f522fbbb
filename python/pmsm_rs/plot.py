"""Pictures of a diagnosis, drawn on axes that the caller gives.

Residuals are measured minus model, in the channel's SI unit. Colours are those of Okabe and Ito, which people
with colour-deficient sight tell apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from .words import channel, subscripted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .results import Diagnosis

Array = NDArray[np.float64]
Trace = Mapping[str, Array]

MEASURED: Final = "#1b1f24"
BEFORE: Final = "#d55e00"
AFTER: Final = "#0072b2"
NOISE: Final = "#8a939c"
_BINS: Final = 420
_FEW: Final = 400


def channels(trace: Trace) -> list[str]:
    """The channels of a trace, in its order."""
    return [name.removesuffix("_measured") for name in trace if name.endswith("_measured")]


def residual(trace: Trace, name: str, when: str) -> Array:
    """Measured minus model of channel `name`, `when` being "before" or "after", shape (samples,)."""
    return trace[f"{name}_measured"] - trace[f"{name}_{when}"]


def symbol_of(name: str) -> tuple[str, str]:
    """Symbol, typeset, and unit of a channel or operating-point variable."""
    symbol, unit = channel(name.removeprefix("op_"))
    return subscripted(symbol, "$_{\\mathrm{", "}}$"), unit


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
    edges = np.linspace(0, len(x), bins + 1).astype(int)
    picks: list[int] = []
    for start, stop in pairwise(edges):
        part = y[start:stop]
        if np.isfinite(part).any():
            picks += sorted({start + int(np.nanargmin(part)), start + int(np.nanargmax(part))})
    return x[picks], y[picks]


def residual_over_time(ax: Axes, trace: Trace, name: str, noise: float | None = None) -> None:
    """Residual before and after over time, with a band of two noise standard deviations."""
    symbol, unit = symbol_of(name)
    if noise:
        ax.axhspan(-2 * noise, 2 * noise, color=NOISE, alpha=0.25, lw=0, label="noise")
        for edge in (-2 * noise, 2 * noise):
            ax.axhline(edge, color=MEASURED, lw=0.7, ls=(0, (4, 3)), zorder=5)
    for when, colour in (("before", BEFORE), ("after", AFTER)):
        t, values = envelope(trace["t"], residual(trace, name, when))
        dots = {"ls": "none", "marker": "o", "ms": 2.0} if len(t) < _FEW else {"lw": 0.6}
        ax.plot(t, values, color=colour, label=when, **dots)
    _label(ax, "t in s", f"{symbol} measured − model in {unit}")


def trajectory(ax: Axes, trace: Trace, name: str, window: tuple[int, int] | None = None) -> None:
    """Measured, before and after over the samples in `window`, by default where before is worst."""
    start, stop = window or worst_window(trace, name)
    symbol, unit = symbol_of(name)
    t = trace["t"][start:stop]
    for part, colour, width in (("measured", MEASURED, 0.9), ("before", BEFORE, 1.1), ("after", AFTER, 1.1)):
        ax.plot(*envelope(t, trace[f"{name}_{part}"][start:stop], 250), color=colour, lw=width, label=part)
    _label(ax, "t in s", f"{symbol} in {unit}")


def worst_window(trace: Trace, name: str, share: float = 0.04, fewest: int = 200) -> tuple[int, int]:
    """First and last sample of the stretch, a `share` of the whole, where the residual before is largest
    in rms.
    """
    values = np.nan_to_num(residual(trace, name, "before")) ** 2
    width = min(len(values), max(fewest, int(share * len(values))))
    total = np.concatenate([[0.0], np.cumsum(values)])
    start = int(np.argmax(total[width:] - total[:-width])) if len(total) > width else 0
    return start, start + width


def residual_over(
    ax: Axes, trace: Trace, name: str, variable: str, noise: float | None = None, bins: int = 24
) -> None:
    """Mean (line) and rms about it (bar) of the residual, before and after, in bins of an operating-point
    variable.
    """
    symbol, unit = symbol_of(name)
    over, over_unit = symbol_of(variable)
    if noise:
        ax.axhspan(-noise, noise, color=NOISE, alpha=0.25, lw=0, label="noise")
    for when, colour in (("before", BEFORE), ("after", AFTER)):
        centre, mean, spread = binned(trace[variable], residual(trace, name, when), bins)
        ax.fill_between(centre, mean - spread, mean + spread, color=colour, alpha=0.15, lw=0)
        ax.plot(centre, mean, color=colour, lw=1.4, marker="o", ms=2.2, label=when)
    _label(ax, f"{over} in {over_unit}", f"{symbol} measured − model in {unit}")


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


def residual_map(
    ax: Axes, trace: Trace, name: str, x: str = "op_omega_e", y: str = "op_i_q", when: str = "before"
) -> None:
    """Mean residual over two operating-point variables; empty cells were not visited.

    Draws its own colour bar.
    """
    values = residual(trace, name, when)
    ok = np.isfinite(values) & np.isfinite(trace[x]) & np.isfinite(trace[y])
    grid = [np.linspace(*_span(trace[v][ok]), cells + 1) for v, cells in ((x, 22), (y, 16))]
    total, *_ = np.histogram2d(trace[x][ok], trace[y][ok], bins=grid, weights=values[ok])
    count, *_ = np.histogram2d(trace[x][ok], trace[y][ok], bins=grid)
    mean = np.ma.masked_array(total / np.maximum(count, 1), mask=count < min(4, max(1, ok.sum() // 400)))
    peak = float(np.ma.filled(np.abs(mean).max(), 0.0)) or 1.0
    symbol, unit = symbol_of(name)
    mesh = ax.pcolormesh(grid[0], grid[1], mean.T, cmap="PuOr_r", vmin=-peak, vmax=peak, lw=0)
    bar = ax.figure.colorbar(mesh, ax=ax, pad=0.02, aspect=30)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0)
    bar.set_label(f"{symbol} measured − model in {unit}")
    _label(ax, *(" in ".join(symbol_of(v)) for v in (x, y)))


def _span(values: Array) -> tuple[float, float]:
    low, high = (float(bound) for bound in np.quantile(values, [0.002, 0.998])) if values.size else (0.0, 1.0)
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def order_spectrum(ax: Axes, trace: Trace, name: str, angle: str = "op_theta_e") -> None:
    """Amplitude of the residual, before and after, at whole orders of the electrical (or mechanical)
    angle.
    """
    symbol, unit = symbol_of(name)
    k = orders()
    for when, colour, shift in (("before", BEFORE, -0.19), ("after", AFTER, 0.19)):
        ax.bar(
            k + shift,
            amplitudes(trace[angle], residual(trace, name, when), k),
            width=0.36,
            color=colour,
            label=when,
        )
    kind = "mechanical" if angle.endswith("_m") else "electrical"
    ax.set_xticks(k)
    _label(ax, f"order of the {kind} angle", f"{symbol} amplitude in {unit}")


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


def overview(answer: Diagnosis) -> Figure:
    """Per channel the residual over time and over the operating point. Raises ValueError without traces."""
    from matplotlib.figure import Figure

    if answer.shown is None:
        raise ValueError("this answer was read back without its traces, so there is nothing to draw")
    trace = answer.traces[answer.shown]
    names = channels(trace)
    figure = Figure(figsize=(10, 2.6 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 2, squeeze=False)
    variable = next((v for v in ("op_i_q", "op_omega_e", "op_i_d") if v in trace), None)
    for row, name in enumerate(names):
        residual_over_time(axes[row, 0], trace, name, answer.noise_floor.get(name))
        if variable is not None:
            residual_over(axes[row, 1], trace, name, variable, answer.noise_floor.get(name))
    axes[0, 0].legend(frameon=False, ncols=3, fontsize="small")
    return figure


def _label(ax: Axes, x: str, y: str) -> None:
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.spines[["top", "right"]].set_visible(False)
    ax.margins(x=0.01)
