"""The sums of terms that explain a balance best, each with shapes that were sought closely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .balance import Balance, Choice, Sides, orthonormal
from .terms import Term, terms

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Firsts of a sum that are tried, and formulas of either length that are fitted anew.
_FIRSTS, _REFINED = 60, 8
# Rounds in which a shape is sought more closely, each with as many steps to either side.
_ROUNDS, _STEPS = 8, 2
# Sweeps over all shapes in a round at most; a round ends where a sweep gains fewer nats than these.
_SWEEPS, _SETTLED = 6, 0.1


@dataclass(frozen=True)
class _Single:
    """A term alone: its sides, a basis of them, and its gain in nats."""

    choice: Choice
    sides: Sides
    basis: Array
    gain: float

    @property
    def term(self) -> Term:
        return self.choice.terms[0][0]


def candidates(run: Balance, both_ways: bool) -> tuple[list[Choice], int]:
    """The best of all terms, alone and in sums of two kinds, with their shapes refined; and how many forms
    of terms were tried. `both_ways` says whether the machine turned in both directions.
    """
    tried = []
    for term in terms(run.form.motion, both_ways):
        for shape in term.points():
            choice = Choice(((term, shape),))
            sides = run.sides(choice)
            if sides is not None:
                tried.append(_Single(choice, sides, orthonormal(sides.values), run.fit(sides).gain))
    tried.sort(key=lambda x: -x.gain)
    scored = sorted(_scored(run, tried), key=lambda x: -x[1])
    # The best alone stand beside the best sums, so that a sum has its parts to compare with.
    lengths = [[choice for choice, _ in scored if len(choice.terms) == count] for count in (1, 2)]
    best = [choice for choices in lengths for choice in choices[:_REFINED]]
    refined = {_key(choice): choice for choice in (_refined(run, choice) for choice in best)}
    return list(refined.values()), len(lengths[0])


def _key(choice: Choice) -> tuple[str, ...]:
    return tuple(sorted(term.text for term, _ in choice.terms))


def _scored(run: Balance, singles: Sequence[_Single]) -> list[tuple[Choice, float]]:
    """All terms alone and the promising ones in sums of two, with their evidence, one of each form."""
    forms: dict[tuple[str, ...], tuple[Choice, float]] = {}

    def offer(choice: Choice, gain: float) -> None:
        found = (choice, gain - run.cost(choice))
        if _key(choice) not in forms or forms[_key(choice)][1] < found[1]:
            forms[_key(choice)] = found

    for single in singles:
        offer(single.choice, single.gain)
    for first in [x for x in singles if x.term.loaded]:
        for second in singles:
            if second.term.kind != first.term.kind:
                both = Choice((*first.choice.terms, *second.choice.terms))
                offer(both, run.fit(first.sides.beside(second.sides)).gain)
    plain = [x for x in singles if not x.term.loaded]
    y = run.target
    stacked = np.column_stack([x.basis for x in plain])
    ends = np.cumsum([0, *(x.basis.shape[1] for x in plain)])
    for first in plain[:_FIRSTS]:
        rest = y - first.basis @ (first.basis.T @ y)
        beside = stacked - first.basis @ (first.basis.T @ stacked)
        projected, squares = beside.T @ rest, np.sum(beside**2, axis=0)
        for k, second in enumerate(plain):
            if second.term.kind == first.term.kind:
                continue
            part = slice(ends[k], ends[k + 1])
            if second.basis.shape[1] == 1:
                size = squares[part][0]
                more = projected[part][0] ** 2 / size if size > 1e-6 else 0.0
            else:
                q = orthonormal(beside[:, part])
                more = float(np.sum((q.T @ rest) ** 2))
            both = Choice((*first.choice.terms, *second.choice.terms))
            offer(both, run.likelihood(float(rest @ rest) - more))
    return list(forms.values())


def _refined(run: Balance, choice: Choice) -> Choice:
    """The same terms with shapes between the points of the grid, one after the other, ever closer."""
    best, worth = choice, run.evidence(choice)
    places = [(a, b) for a, (term, _) in enumerate(choice.terms) for b in range(len(term.shapes))]
    factor = 1.6
    for _ in range(_ROUNDS):
        for _ in range(_SWEEPS):
            before = worth
            for place, k in places:
                for step in (*range(-_STEPS, 0), *range(1, _STEPS + 1)):
                    other = _with_shape(best, place, k, factor ** (step / _STEPS))
                    found = run.evidence(other)
                    if found > worth:
                        best, worth = other, found
            if worth - before < _SETTLED:
                break
        factor = factor**0.5
    return best


def _with_shape(choice: Choice, place: int, k: int, factor: float) -> Choice:
    """The choice with one shape multiplied by a factor; within its bounds."""
    changed = list(choice.terms)
    term, shape = changed[place]
    moved = shape[k] * factor
    moved = min(max(moved, term.shapes[k].low), term.shapes[k].high)
    changed[place] = (term, (*shape[:k], moved, *shape[k + 1 :]))
    return Choice(tuple(changed))
