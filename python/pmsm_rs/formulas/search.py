"""A formula for a torque that has no name: small sums of terms over speed, angle, motor torque and time.

Terms are typed by their dimension and symmetry: friction is odd in the speed, a torque over the angle is
periodic. All are tried on the equation of motion in weak form, alone and in pairs, and compared by evidence.
The best are fitted anew and checked on the validation run. A formula is a hypothesis, never a name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .terms import Term, terms
from .weak_form import Motion, WeakForm

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Formulas that are told at most, firsts of a sum that are tried, and formulas that are fitted anew.
_TOLD, _FIRSTS, _REFINED = 5, 60, 8
# Rounds in which a shape is sought more closely, each with as many steps to either side.
_ROUNDS, _STEPS = 8, 2
# Sweeps over all shapes in a round at most; a round ends where a sweep gains fewer nats than these.
_SWEEPS, _SETTLED = 6, 0.1
# Windows overlap by half, so that they are worth less than their number.
_INDEPENDENT = 0.75
# Share of its amplitude by which the form of a simple formula is uncertain, as for effects of the catalogue:
# what is smaller is no evidence for another form.
_FORM = 0.02
# Share of what remains that a formula must take away from both runs to be told at all.
_LEAST = 0.5
# Nats within which two formulas cannot be told apart: odds of 20 to 1.
_APART = 3.0


@dataclass(frozen=True)
class Formula:
    """A formula for an unknown torque against positive rotation, N·m.

    `text` is the formula, `parameters` its numbers by name with value and unit. `explains` is the share of
    the remaining mean square that it takes away, on "recording" and, where there is one, "validation".
    `evidence` is that of the formula over none, in nats. `equivalent` says that it cannot be told from the
    first.
    """

    text: str
    parameters: Mapping[str, tuple[float, str]]
    explains: Mapping[str, float]
    evidence: float
    equivalent: bool

    def to_dict(self) -> dict[str, Any]:
        """As its JSON object."""
        values = {name: {"value": x, "unit": unit} for name, (x, unit) in self.parameters.items()}
        return {
            "formula": self.text,
            "parameters": values,
            "explains": dict(self.explains),
            "evidence": self.evidence,
            "equivalent": self.equivalent,
        }


@dataclass(frozen=True)
class _Choice:
    """Terms of a sum with their shapes."""

    terms: tuple[tuple[Term, tuple[float, ...]], ...]

    def columns(self, moved: Motion) -> list[Array]:
        return [column for term, shape in self.terms for column in term.columns(moved, shape)]

    @property
    def count(self) -> int:
        return sum(term.count for term, _ in self.terms)


@dataclass(frozen=True)
class _Run:
    """A run in weak form: its left sides with what the base parameters and the load can do taken out."""

    form: WeakForm
    open: Array
    target: Array

    def column(self, values: Array) -> Array:
        """The integrals of a torque, with what the open parameters can do taken out."""
        return self._cleared(self.form.integral(values))

    def _cleared(self, column: Array) -> Array:
        cleared: Array = column - self.open @ (self.open.T @ column)
        return cleared


def _run(form: WeakForm, j: float) -> _Run:
    moved = form.motion
    raw = form.integral(moved.driving) + j * form.momentum()
    nuisance = [form.momentum(), form.integral(moved.omega_m)]
    if moved.load_open:
        nuisance.append(form.integral(np.ones_like(moved.t)))
    basis = _orthonormal(nuisance)
    return _Run(form, basis, raw - basis @ (basis.T @ raw))


def _orthonormal(columns: Sequence[Array]) -> Array:
    """An orthonormal basis of the columns; directions of no size are left out."""
    scaled = np.column_stack([c / (np.linalg.norm(c) or 1.0) for c in columns])
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    basis: Array = u[:, s > 1e-9]
    return basis


def search(form: WeakForm, validation: WeakForm | None, *, j: float) -> list[Formula]:
    """The formulas for what remains, the most credible first; none where no simple one does.

    `form` and `validation` are the runs in weak form, `j` is the inertia (kg·m²).
    """
    run = _run(form, j)
    check = None if validation is None else _run(validation, j)
    total = float(run.target @ run.target)
    if not total > 0.0:
        return []
    tried = [
        (_Choice(((term, shape),)), _orthonormal_of(run, term.columns(form.motion, shape)))
        for term in terms(form.motion)
        for shape in term.points()
    ]
    tried = [(choice, basis) for choice, basis in tried if basis.shape[1]]
    kinds = len({_key(choice) for choice, _ in tried})
    scored = sorted(_scored(run, tried), key=lambda x: -x[1])
    # The best alone stand beside the best sums, so that a sum has its parts to compare with.
    best = [
        choice for count in (1, 2) for choice in [c for c, _ in scored if len(c.terms) == count][:_REFINED]
    ]
    refined = {_key(choice): choice for choice in (_refined(run, choice) for choice in best)}
    return _told(run, check, list(refined.values()), kinds)


def _key(choice: _Choice) -> tuple[str, ...]:
    return tuple(sorted(term.text for term, _ in choice.terms))


def _orthonormal_of(run: _Run, values: Sequence[Array]) -> Array:
    columns = [run.column(x) for x in values]
    if not all(np.isfinite(c).all() for c in columns):
        return np.empty((len(run.target), 0))
    return (
        _orthonormal(columns)
        if any(np.linalg.norm(c) > 0.0 for c in columns)
        else np.empty((len(run.target), 0))
    )


def _scored(run: _Run, tried: Sequence[tuple[_Choice, Array]]) -> list[tuple[_Choice, float]]:
    """All terms alone and the promising ones in pairs, with their evidence, one of each kind."""
    y = run.target
    singles = [(choice, basis, float(np.sum((basis.T @ y) ** 2))) for choice, basis in tried]
    singles.sort(key=lambda x: -x[2])
    kinds: dict[tuple[str, ...], tuple[_Choice, float]] = {}

    def offer(choice: _Choice, taken: float) -> None:
        found = (choice, _worth(run, choice.count, float(y @ y) - taken))
        if _key(choice) not in kinds or kinds[_key(choice)][1] < found[1]:
            kinds[_key(choice)] = found

    for choice, _, taken in singles:
        offer(choice, taken)
    stacked = np.column_stack([basis for _, basis, _ in singles])
    ends = np.cumsum([0, *(basis.shape[1] for _, basis, _ in singles)])
    for first, basis, taken in singles[:_FIRSTS]:
        rest = y - basis @ (basis.T @ y)
        beside = stacked - basis @ (basis.T @ stacked)
        projected, squares = beside.T @ rest, np.sum(beside**2, axis=0)
        for k, (second, own, _) in enumerate(singles):
            if second.terms[0][0] is first.terms[0][0]:
                continue
            part = slice(ends[k], ends[k + 1])
            if own.shape[1] == 1:
                size = squares[part][0]
                more = projected[part][0] ** 2 / size if size > 1e-6 else 0.0
            else:
                q = _orthonormal(list(beside[:, part].T))
                more = float(np.sum((q.T @ rest) ** 2))
            offer(_Choice((*first.terms, *second.terms)), taken + more)
    return list(kinds.values())


def _worth(run: _Run, count: int, left: float) -> float:
    """The evidence of a formula over none, nats, of unknown noise (Schwarz, Ann. Statist. 6 (1978) 461)."""
    n = _INDEPENDENT * len(run.target)
    total = float(run.target @ run.target)
    left = max(left, 0.0) + _FORM**2 * total
    return 0.5 * n * math.log(total / left) - 0.5 * count * math.log(n)


def _evidence(run: _Run, choice: _Choice) -> float:
    basis = _orthonormal_of(run, choice.columns(run.form.motion))
    left = run.target - basis @ (basis.T @ run.target)
    return _worth(run, choice.count, float(left @ left))


def _refined(run: _Run, choice: _Choice) -> _Choice:
    """The same terms with shapes between the points of the grid, one after the other, ever closer."""
    best, worth = choice, _evidence(run, choice)
    places = [(a, b) for a, (term, _) in enumerate(choice.terms) for b in range(len(term.shapes))]
    factor = 1.6
    for _ in range(_ROUNDS):
        for _ in range(_SWEEPS):
            before = worth
            for place, k in places:
                for step in (*range(-_STEPS, 0), *range(1, _STEPS + 1)):
                    other = _with_shape(best, place, k, factor ** (step / _STEPS))
                    found = _evidence(run, other)
                    if found > worth:
                        best, worth = other, found
            if worth - before < _SETTLED:
                break
        factor = factor**0.5
    return best


def _with_shape(choice: _Choice, place: int, k: int, factor: float) -> _Choice:
    """The choice with one shape multiplied by a factor; within its bounds."""
    changed = list(choice.terms)
    term, shape = changed[place]
    moved = shape[k] * factor
    moved = min(max(moved, term.shapes[k].low), term.shapes[k].high)
    changed[place] = (term, (*shape[:k], moved, *shape[k + 1 :]))
    return _Choice(tuple(changed))


def _told(run: _Run, check: _Run | None, choices: Sequence[_Choice], kinds: int) -> list[Formula]:
    """The formulas that describe both runs. Before anything is measured each single term of as many `kinds`
    is as likely as any other, and so is each sum of two.
    """
    prior = {1: math.log(max(kinds, 1)), 2: math.log(max(kinds * (kinds - 1) // 2, 1))}
    told: list[tuple[float, _Choice, Formula]] = []
    for choice in choices:
        columns = choice.columns(run.form.motion)
        matrix = np.column_stack([run.column(c) for c in columns])
        scale = np.linalg.norm(matrix, axis=0)
        if not np.all(scale > 0.0):
            continue
        strengths = np.linalg.lstsq(matrix / scale, run.target, rcond=1e-9)[0] / scale
        explains = {"recording": _share(run, matrix @ strengths)}
        worth = _evidence(run, choice) - prior[len(choice.terms)]
        if check is not None:
            other = np.column_stack([check.column(c) for c in choice.columns(check.form.motion)])
            explains["validation"] = _share(check, other @ strengths)
            # Strengths and shapes are those of the recording; the open parameters are free here, too.
            left = 1.0 - explains["validation"] + _FORM**2
            worth -= 0.5 * _INDEPENDENT * len(check.target) * math.log(left)
        if min(explains.values()) >= _LEAST:
            told.append((worth, choice, _formula(choice, strengths, explains, worth)))
    told.sort(key=lambda x: -x[0])
    alone = {choice.terms[0][0].text: worth for worth, choice, _ in told if len(choice.terms) == 1}

    def needed(worth: float, choice: _Choice) -> bool:
        """Whether a sum does more than its parts."""
        parts = [alone.get(term.text, -math.inf) for term, _ in choice.terms]
        return len(choice.terms) == 1 or worth > max(parts) + _APART

    kept = [(worth, formula) for worth, choice, formula in told if needed(worth, choice)]
    kept = [(worth, formula) for worth, formula in kept if worth > 0.0][:_TOLD]
    first = kept[0][0] if kept else 0.0
    return [
        replace(formula, equivalent=k > 0 and first - worth < _APART)
        for k, (worth, formula) in enumerate(kept)
    ]


def _share(run: _Run, predicted: Array) -> float:
    """The share of the mean square that the prediction takes away; below zero where it adds."""
    left = run.target - predicted
    return 1.0 - float(left @ left) / float(run.target @ run.target)


def _formula(choice: _Choice, strengths: Array, explains: Mapping[str, float], evidence: float) -> Formula:
    texts, parameters, at = [], {}, 0
    for number, (term, shape) in enumerate(choice.terms, 1):
        tail = str(number) if len(choice.terms) > 1 else ""
        names = {}
        for name, unit in term.strengths:
            names[name] = name + tail
            parameters[name + tail] = (float(strengths[at]), unit)
            at += 1
        for sought, x in zip(term.shapes, shape, strict=True):
            names[sought.name] = sought.name + tail
            parameters[sought.name + tail] = (float(x), sought.unit)
        texts.append(term.text.format(**names))
    return Formula(" + ".join(texts), parameters, explains, evidence, False)
