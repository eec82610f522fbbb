"""The budget of the mismatch: which share each effect takes away, in words and as a picture."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from .words import channel, lower_first, percent, title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .results import Budget

LEAST: Final = 0.005
"""Shares below this are not told."""
_COLOURS: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#f0e442", "#d55e00")
_DARK: Final = ("#0072b2", "#d55e00", "#6b7480")
_PLAIN: Final = {"shared by several": "#b8c0c8", "map without a name": "#6b7480", "left": "#e3e7ea"}


def shares(budget: Budget) -> list[tuple[str, float]]:
    """What takes which share away, in words; what is left comes last."""
    named = [(title(part.effect), part.beside) for part in budget.parts]
    plain = [("shared by several", budget.shared), ("map without a name", budget.unmodelled)]
    told = [*named, *plain, ("left", budget.rest)]
    return [(name, share) for name, share in told if share >= LEAST]


def sentence(budget: Budget) -> str:
    """In plain words: "Of 5.4 times the noise in i_q: dead time 61 %, saturation 22 %, left 5 %"."""
    told = ", ".join(f"{lower_first(name)} {percent(share)}" for name, share in shares(budget))
    return f"Of {budget.before:.3g} times the noise in {channel(budget.channel)[0]}: {told}."


def judged(budgets: Iterable[Budget]) -> list[Budget]:
    """Those of the validation run where it has any, else those of the recording."""
    every = list(budgets)
    return [b for b in every if b.run == "validation"] or every


def draw(budgets: Iterable[Budget], ax: Axes) -> Axes:
    """One bar per channel, divided by what takes which share of its mismatch away; returns the axes.

    Below the channel stands how many times the noise was left before and after.
    """
    every = list(budgets)
    names = list(dict.fromkeys(name for budget in every for name, _ in shares(budget)))
    effects = [name for name in names if name not in _PLAIN]
    colours = dict(zip(effects, _COLOURS * len(effects), strict=False)) | _PLAIN
    for row, budget in enumerate(every):
        start = 0.0
        for name, share in shares(budget):
            ax.barh(row, 100 * share, left=100 * start, height=0.6, color=colours[name], label=name)
            if share > 0.07:
                middle, ink = 100 * (start + share / 2), "white" if colours[name] in _DARK else "black"
                text = ax.text(middle, row, percent(share), ha="center", va="center", color=ink)
                text.set_fontsize("small")
            start += share
    labels = [f"{channel(budget.channel)[0]}\n{budget.before:.3g}× → {budget.after:.3g}×" for budget in every]
    ax.set_yticks(range(len(every)), labels)
    ax.invert_yaxis()
    ax.set_xlim(0, 100)
    ax.set_xlabel("share of the mismatch in %")
    handles = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    ax.legend(
        handles.values(),
        handles.keys(),
        frameon=False,
        fontsize="small",
        ncols=2,
        loc="lower left",
        bbox_to_anchor=(0, 1),
    )
    return ax
