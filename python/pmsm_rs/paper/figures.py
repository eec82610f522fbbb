"""Figs. 5 to 8, drawn anew."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import atomic
from . import setup
from .runs import Following, Run, Search

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TRUE, _FOUND, _COST = "#8a8f98", "#1f5fa8", "#1f5fa8"
_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "pmsm-rs",
}


def fig5(found: Search) -> Figure:
    """Cost, r_s and load torque of the best particle after each generation of one window."""
    figure, axes = _panels(3, (6.0, 5.6))
    generations = np.arange(1, len(found.cost) + 1)
    axes[0].plot(generations, found.cost, color=_COST, drawstyle="steps-post")
    _logarithmic(axes[0])
    axes[0].set_ylabel("cost (9), A²")
    for ax, values, truth, label in (
        (axes[1], found.r_s, found.truth[0], "r_s, Ω"),
        (axes[2], found.load, found.truth[1], "T_Ld, N·m"),
    ):
        ax.axhline(truth, color=_TRUE, linestyle="--", label="true mean of the window")
        ax.plot(generations, values, color=_FOUND, drawstyle="steps-post", label="best particle")
        ax.set_ylabel(label)
    for ax in axes:
        ax.axvline(setup.PAPER_GENERATIONS, color=_TRUE, linewidth=0.7, linestyle=":")
    axes[1].legend(fontsize="small", ncols=2, frameon=False)
    axes[-1].set_xlabel("generation (dotted: the 20 of the paper)")
    return figure


def fig6(data: Run, found: Following) -> Figure:
    """True and identified r_s over time."""
    return _tracked(data.t, data.r_s, found, 0, "r_s", "r_s, Ω")


def fig7(data: Run, found: Following) -> Figure:
    """True and identified disturbed load torque over time."""
    return _tracked(data.t, data.load, found, 1, "tau_load", "T_Ld, N·m")


def fig8(found: Following) -> Figure:
    """Best cost over the generations of all windows, one after the other."""
    figure, axes = _panels(1, (7.2, 2.8))
    ax, per = axes[0], setup.SWARM.iterations
    for k, window in enumerate(found.windows):
        history = np.array(window.history[: per + 1])
        ax.plot(k * per + np.arange(len(history)), history, color=_COST, drawstyle="steps-post")
        ax.axvline((k + 1) * per, color=_TRUE, linewidth=0.5, linestyle=":")
    ticks = range(len(found.windows) + 1)
    ax.set_xticks([k * per for k in ticks], ["0", *(f"{k}·{per}" for k in ticks if k)])
    _logarithmic(ax)
    ax.set_xlabel("generations, window after window")
    ax.set_ylabel("cost (9), A²")
    return figure


def write(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Writes a figure as NAME.png and NAME.svg; the same figure gives the same bytes. Raises UsageError."""
    import matplotlib

    files = []
    for kind, keep in (("png", {"Software": None}), ("svg", {"Date": None, "Creator": None})):
        path = folder / f"{name}.{kind}"

        def fill(draft: Path, kind: str = kind, keep: dict[str, Any] = keep) -> None:
            with matplotlib.rc_context(_STYLE):
                figure.savefig(draft, format=kind, dpi=130, metadata=keep)

        atomic.write(path, fill)
        files.append(path)
    return files


def _tracked(
    t: np.ndarray[Any, Any], truth: np.ndarray[Any, Any], found: Following, at: int, name: str, label: str
) -> Figure:
    figure, axes = _panels(1, (6.0, 2.8))
    ax = axes[0]
    ax.plot(t, truth, color=_TRUE, linewidth=1.0, label="true")
    means = [true[at] for true in found.truth]
    middles = [0.5 * (window.t_start + window.t_end) for window in found.windows]
    ax.plot(
        middles, means, "o", color=_TRUE, markersize=7, fillstyle="none", label="true, mean of the window"
    )
    values = [window.parameters[name].value or np.nan for window in found.windows]
    for window, value in zip(found.windows, values, strict=True):
        ax.plot([window.t_start, window.t_end], [value, value], color=_FOUND, linewidth=1.6)
    ax.plot(middles, values, "x", color=_FOUND, label="identified in the window")
    ax.set_xlabel("t, s")
    ax.set_ylabel(label)
    ax.legend(fontsize="small", frameon=False)
    return figure


def _logarithmic(ax: Axes) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())


def _panels(rows: int, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=size, layout="constrained", facecolor="white")
        axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    return figure, list(axes)
