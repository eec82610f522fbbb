"""The budget of the mismatch: which share each effect takes away, in words and in figures."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from .findings import Budget
from .rounding import short
from .words import channel, lower_first, percent, title

LEAST: Final = 0.005
"""Shares below this are not told."""
SHARED: Final = "shared by several"
UNNAMED: Final = "map without a name"
REST: Final = "rest"


def shares(budget: Budget) -> list[tuple[str, float]]:
    """What takes which share away, in words; the rest comes last."""
    named = [(title(part.effect), part.beside) for part in budget.parts]
    plain = [(SHARED, budget.shared), (UNNAMED, budget.unmodelled)]
    told = [*named, *plain, (REST, budget.rest)]
    return [(name, share) for name, share in told if share >= LEAST]


def sentence(budget: Budget) -> str:
    """In plain words: "Of 5.4 times the noise in i_q: dead time 61 %, saturation 22 %, rest 5 %". Where the
    model is worse than the dq-model there is no share.
    """
    if budget.after > budget.before:
        what = f"{channel(budget.channel)[0]} the residual grows from {short(budget.before, 3)}"
        return f"In {what} to {short(budget.after, 3)} times the noise: the model does not predict this run."
    told = ", ".join(f"{lower_first(name)} {percent(share)}" for name, share in shares(budget))
    return f"Of {short(budget.before, 3)} times the noise in {channel(budget.channel)[0]}: {told}."


def judged(budgets: Iterable[Budget]) -> list[Budget]:
    """Those of the validation run where it has any, else those of the recording."""
    every = list(budgets)
    return [b for b in every if b.run == "validation"] or every
