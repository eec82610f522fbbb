"""Pictures of a diagnosis and of an identification, on plain matplotlib axes.

Every function draws on `ax`, or on axes of a new figure of pyplot, and returns the axes to be restyled. Where
a `source` is asked for, it is a diagnosis or one of its `traces`. Of a diagnosis the validation run is drawn
with its noise, or the recording where there is none. Residuals are measured minus model, in the channel's SI
unit. Colours are those of Okabe and Ito, which people with colour-deficient sight tell apart.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from .._core import UsageError
from ..errors import did_you_mean, refuse
from ..results import traces
from ..results.traces import Trace
from ..results.unmodelled import reach
from ..results.words import channel, subscripted
from ..results.words import unit as unit_of
from . import palette

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..results.estimates import IdentificationValues
    from ..results.findings import DiagnosisValues
    from ..results.unmodelled import Term

    Source = DiagnosisValues | Mapping[str, NDArray[np.float64]]


MEASURED: Final = palette.LIGHT["measured"]
BEFORE: Final = palette.LIGHT["before"]
AFTER: Final = palette.LIGHT["after"]
NOISE: Final = palette.LIGHT["noise"]
_FEW: Final = 400
_OPEN, _CLOSE = "$_{\\mathrm{", "}}$"


def symbol_of(name: str) -> tuple[str, str]:
    """Gives the typeset symbol and the unit of a channel or variable.

    Parameters
    ----------
    name : str
        Such as `i_q` or `op_omega_e`.

    Returns
    -------
    tuple of (str, str)
        Symbol and unit.
    """
    symbol, unit = channel(name.removeprefix("op_"))
    return subscripted(symbol, _OPEN, _CLOSE), unit


def residual_over_time(
    source: Source, name: str, noise: float | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draws the residual before and after over time, with a band of two noise standard deviations.

    Parameters
    ----------
    source : Diagnosis or mapping
        A diagnosis, or one of its `traces`.
    name : str
        The channel, such as `i_q`.
    noise : float or None, default None
        Standard deviation of the noise in the channel's unit; None takes that of the diagnosis.
    ax : Axes or None, default None
        Where to draw; None makes a figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.
    """
    trace, noise = _trace(source, name), _noise(source, name, noise)
    ax = _axes(ax)
    symbol, unit = symbol_of(name)
    if noise:
        ax.axhspan(-2 * noise, 2 * noise, color=NOISE, alpha=0.25, lw=0, label="noise")
        for edge in (-2 * noise, 2 * noise):
            ax.axhline(edge, color=MEASURED, lw=0.7, ls=(0, (4, 3)), zorder=5)
    for when, colour in (("before", BEFORE), ("after", AFTER)):
        t, values = traces.envelope(trace["t"], traces.residual(trace, name, when))
        dots = {"ls": "none", "marker": "o", "ms": 2.0} if len(t) < _FEW else {"lw": 0.6}
        ax.plot(t, values, color=colour, label=when, **dots)
    return _label(ax, "t in s", f"{symbol} measured − model in {unit}")


def trajectory(
    source: Source, name: str, window: tuple[int, int] | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draws measured, before and after.

    Parameters
    ----------
    source : Diagnosis or mapping
        A diagnosis, or one of its `traces`.
    name : str
        The channel, such as `i_q`.
    window : tuple of (int, int) or None, default None
        First and last sample; None takes them where `before` is worst.
    ax : Axes or None, default None
        Where to draw; None makes a figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.
    """
    trace = _trace(source, name)
    ax = _axes(ax)
    start, stop = window or traces.worst_window(trace, name)
    symbol, unit = symbol_of(name)
    t = trace["t"][start:stop]
    for part, colour, width in (("measured", MEASURED, 0.9), ("before", BEFORE, 1.1), ("after", AFTER, 1.1)):
        ax.plot(
            *traces.envelope(t, trace[f"{name}_{part}"][start:stop], 250), color=colour, lw=width, label=part
        )
    return _label(ax, "t in s", f"{symbol} in {unit}")


def residual_over(
    source: Source,
    name: str,
    variable: str,
    noise: float | None = None,
    bins: int = 24,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draws mean (line) and rms about it (band) of the residual in bins of a variable, before and after.

    Parameters
    ----------
    source : Diagnosis or mapping
        A diagnosis, or one of its `traces`.
    name : str
        The channel, such as `i_q`.
    variable : str
        A variable of the operating point, such as `op_i_q`.
    noise : float or None, default None
        Standard deviation of the noise in the channel's unit; None takes that of the diagnosis.
    bins : int, default 24
        Number of bins.
    ax : Axes or None, default None
        Where to draw; None makes a figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.
    """
    trace, noise = _trace(source, name, variable), _noise(source, name, noise)
    ax = _axes(ax)
    symbol, unit = symbol_of(name)
    over, over_unit = symbol_of(variable)
    if noise:
        ax.axhspan(-noise, noise, color=NOISE, alpha=0.25, lw=0, label="noise")
    for when, colour in (("before", BEFORE), ("after", AFTER)):
        centre, mean, spread = traces.binned(trace[variable], traces.residual(trace, name, when), bins)
        ax.fill_between(centre, mean - spread, mean + spread, color=colour, alpha=0.15, lw=0)
        ax.plot(centre, mean, color=colour, lw=1.4, marker="o", ms=2.2, label=when)
    return _label(ax, f"{over} in {over_unit}", f"{symbol} measured − model in {unit}")


def residual_map(
    source: Source,
    name: str,
    x: str = "op_omega_e",
    y: str = "op_i_q",
    when: str = "before",
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draws the mean residual over two operating-point variables; empty cells were not visited.

    It draws its own colour bar.

    Parameters
    ----------
    source : Diagnosis or mapping
        A diagnosis, or one of its `traces`.
    name : str
        The channel, such as `i_q`.
    x, y : str, default "op_omega_e" and "op_i_q"
        The variables.
    when : str, default "before"
        "before" or "after".
    ax : Axes or None, default None
        Where to draw; None makes a figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.
    """
    trace = _trace(source, name, x, y)
    ax = _axes(ax)
    values = traces.residual(trace, name, when)
    *grid, cells = traces.mean_map(trace[x], trace[y], values, (22, 16))
    mean = np.ma.masked_invalid(cells)
    peak = float(np.ma.filled(np.abs(mean).max(), 0.0)) or 1.0
    symbol, unit = symbol_of(name)
    mesh = ax.pcolormesh(grid[0], grid[1], mean.T, cmap="PuOr_r", vmin=-peak, vmax=peak, lw=0)
    bar = ax.figure.colorbar(mesh, ax=ax, pad=0.02, aspect=30)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0)
    bar.set_label(f"{symbol} measured − model in {unit}")
    return _label(ax, *(" in ".join(symbol_of(v)) for v in (x, y)))


def order_spectrum(source: Source, name: str, angle: str = "op_theta_e", *, ax: Axes | None = None) -> Axes:
    """Draws the amplitude of the residual at whole orders of an angle, before and after.

    Parameters
    ----------
    source : Diagnosis or mapping
        A diagnosis, or one of its `traces`.
    name : str
        The channel, such as `i_q`.
    angle : str, default "op_theta_e"
        `op_theta_e` (electrical) or `op_theta_m` (mechanical).
    ax : Axes or None, default None
        Where to draw; None makes a figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.
    """
    trace = _trace(source, name, angle)
    ax = _axes(ax)
    symbol, unit = symbol_of(name)
    k = traces.orders()
    for when, colour, shift in (("before", BEFORE, -0.19), ("after", AFTER, 0.19)):
        ax.bar(
            k + shift,
            traces.amplitudes(trace[angle], traces.residual(trace, name, when), k),
            width=0.36,
            color=colour,
            label=when,
        )
    kind = "mechanical" if angle.endswith("_m") else "electrical"
    ax.set_xticks(k)
    return _label(ax, f"order of the {kind} angle", f"{symbol} amplitude in {unit}")


def unmodelled(term: Term, *, ax: Axes | None = None) -> Axes:
    """Draws a term of a map of what no candidate explains.

    A term of one variable is drawn as lines, one for either direction of rotation where it depends on that. A
    term of two is drawn in colours with their own colour bar.

    Parameters
    ----------
    term : Term
        One of `answer.unmodelled.terms`.
    ax : Axes or None, default None
        Where to draw; None makes a figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.
    """
    ax = _axes(ax)
    first, *rest = term.variables
    names = [variable["variable"] for variable in term.variables]
    labels = [f"{symbol_of(v['variable'])[0]} in {unit_of(v['unit'])}" for v in term.variables]
    kind = term.quantity
    value = f"{subscripted(kind, _OPEN, _CLOSE)} in {unit_of(term.unit)}"
    if rest and rest[0]["basis"] != "direction":
        x, y = np.meshgrid(*(np.linspace(*reach(variable), 81) for variable in term.variables))
        mesh = ax.pcolormesh(x, y, term(**{names[0]: x, names[1]: y}), cmap="PuOr_r", shading="auto", lw=0)
        bar = ax.figure.colorbar(mesh, ax=ax, pad=0.02, aspect=30)
        bar.outline.set_visible(False)
        bar.ax.tick_params(length=0)
        bar.set_label(value)
        return _label(ax, *labels)
    x = np.linspace(*reach(first), 241)
    if rest:
        for way, sign, colour in (("forwards", 1.0, AFTER), ("backwards", -1.0, BEFORE)):
            fast = np.full_like(x, sign * 10 * rest[0]["width"])
            ax.plot(x, term(**{names[0]: x, names[1]: fast}), color=colour, lw=1.4, label=way)
        ax.legend(frameon=False)
    else:
        ax.plot(x, term(**{names[0]: x}), color=AFTER, lw=1.4)
    return _label(ax, labels[0], value)


def history(answer: IdentificationValues, *, ax: Axes | None = None) -> Axes:
    """Draws the best cost of each generation of an identification's swarm.

    Parameters
    ----------
    answer : Identification
        What `identify` returned.
    ax : Axes or None, default None
        Where to draw; None makes a figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.
    """
    ax = _axes(ax)
    ax.semilogy(np.arange(1, len(answer.history) + 1), answer.history, color=AFTER, lw=1.4)
    return _label(ax, "generation", "best cost")


def overview(answer: DiagnosisValues) -> Figure:
    """Draws per channel the residual over time and over the operating point.

    Parameters
    ----------
    answer : Diagnosis
        What `diagnose` returned.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    UsageError
        Without traces.
    """
    trace = _trace(answer)
    names = traces.channels(trace)
    figure = _shown_in_notebooks()(figsize=(10, 2.6 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 2, squeeze=False)
    variable = next((v for v in ("op_i_q", "op_omega_e", "op_i_d") if v in trace), None)
    for row, name in enumerate(names):
        residual_over_time(answer, name, ax=axes[row, 0])
        if variable is not None:
            residual_over(answer, name, variable, ax=axes[row, 1])
    axes[0, 0].legend(frameon=False, ncols=3, fontsize="small")
    return figure


@cache
def _shown_in_notebooks() -> type[Figure]:
    """A figure that a notebook shows without pyplot, of which every other figure would have to be closed."""
    from matplotlib.figure import Figure

    class Shown(Figure):
        def _repr_png_(self) -> bytes:
            out = io.BytesIO()
            self.savefig(out, format="png", dpi=110)
            return out.getvalue()

    return Shown


def _trace(source: Source, name: str | None = None, *over: str) -> Trace:
    """The trace to draw. Raises UsageError where there is none, none of channel `name`, or no column to draw
    it `over`.
    """
    trace = source if isinstance(source, Mapping) else _judged(source)
    if name is not None and f"{name}_measured" not in trace:
        raise refuse(
            UsageError, f"there is no channel '{name}'", fix=did_you_mean(name, traces.channels(trace))
        )
    for variable in over:
        if variable not in trace:
            raise refuse(UsageError, f"there is no column '{variable}'", fix=did_you_mean(variable, trace))
    return trace


def _judged(source: DiagnosisValues) -> Trace:
    if source.shown is None:
        raise refuse(
            UsageError,
            "this answer was read back without its traces, so there is nothing to draw",
            fix="diagnose the recording again",
        )
    return source.traces[source.shown]


def _noise(source: Source, name: str, given: float | None) -> float | None:
    return given if given is not None or isinstance(source, Mapping) else source.noise_floor.get(name)


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.figure(layout="constrained").subplots()


def _label(ax: Axes, x: str, y: str) -> Axes:
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.spines[["top", "right"]].set_visible(False)
    ax.margins(x=0.01)
    return ax
