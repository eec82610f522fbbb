"""The picture of a recording: what was measured, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from ..plot import _shown_in_notebooks
from ..quantities.canonical import CANONICAL, ordered
from ..results.traces import envelope

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .._core import Recording

COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")
"""Those of Okabe and Ito, which people with colour-deficient sight tell apart."""
_FEW: Final = 400
"""Samples up to which each is a dot."""
_APART: Final = {"v_dc": "DC link"}
"""Columns with axes of their own: their size would flatten the others."""


def waveforms(recording: Recording) -> Figure:
    """One pair of axes for each quantity over time, in SI units; the angle only where there is no speed.

    Long recordings are thinned to the smallest and largest value of each stretch, so that no peak is lost.
    """
    panels: dict[str, list[str]] = {}
    for name in ordered(recording.names):
        if name != "t":
            panels.setdefault(_APART.get(name, CANONICAL[name].dimension), []).append(name)
    if "speed" in panels:
        panels.pop("angle", None)
    figure = _shown_in_notebooks()(figsize=(10, 0.6 + 1.7 * len(panels)), layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    t = recording.column("t")
    dots = {"ls": "none", "marker": "o", "ms": 2.0} if len(t) < _FEW else {"lw": 0.7}
    for ax, (panel, names) in zip(axes, panels.items(), strict=True):
        for name, colour in zip(names, COLOURS, strict=False):
            ax.plot(*envelope(t, recording.column(name)), color=colour, label=name, **dots)
        ax.set_ylabel(f"{panel} in {CANONICAL[names[0]].unit}")
        ax.spines[["top", "right"]].set_visible(False)
        ax.margins(x=0.01)
        ax.legend(frameon=False, fontsize="small", ncols=len(names), loc="upper right")
    axes[-1].set_xlabel("t in s")
    return figure
