"""A formula for a torque that has no name: small sums of terms over speed, angle, motor torque and time.

Terms are typed by their dimension and symmetry: friction is odd in the speed, a torque over the angle is
periodic. All are tried on the equation of motion in weak form, alone and in pairs, and compared by evidence.
The best are fitted anew, and free runs of the speed say what they predict on data to which they were not
fitted. A formula is a hypothesis, never a name, also where it has the form of an effect of the catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..results.registry import effect
from .balance import FORM, Balance, Choice
from .free_run import centred, free_runs, gained
from .screening import candidates
from .spread import WHY_NONE, spread
from .terms import Term, reverses
from .weak_form import Motion, WeakForm

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Formulas that are told at most.
_TOLD = 5
# Share of what remains that a formula must take away from each run to be told at all.
_LEAST = 0.5
# Nats within which two formulas cannot be told apart: odds of 20 to 1.
_APART = 3.0
_STRIBECK = "stribeck_friction"
# Stretches of a run, of which every other one is predicted by a formula with the numbers of the rest.
_STRETCHES = 10


class Number(NamedTuple):
    """A number of a formula in its `unit`; `stderr` is None where the recording does not determine it."""

    value: float
    unit: str
    stderr: float | None

    def to_dict(self) -> dict[str, Any]:
        """As its JSON object."""
        why = None if self.stderr is not None else WHY_NONE
        return {**self._asdict(), "why_none": why}


@dataclass(frozen=True)
class Formula:
    """A formula for an unknown torque against positive rotation, N·m.

    `text` is the formula, `parameters` its numbers by name. `residual` is the rms error
    of the mechanical speed in free runs, rad/s, without and with the formula. `explains` is the share of the
    mean square that it takes away. Both are by run, "recording" and, where there is one, "validation". No
    number but a shape was fitted to the rows that it predicts there. `evidence` is that of the formula over
    none, in nats. `equivalent` says that it cannot be told from the first. `effects` are the effects of the
    catalogue whose law its terms have, None for a term of another law.
    """

    text: str
    parameters: Mapping[str, Number]
    residual: Mapping[str, tuple[float, float]]
    evidence: float
    equivalent: bool
    effects: tuple[str | None, ...]

    @property
    def explains(self) -> dict[str, float]:
        """The share of the mean square that it takes away from each run."""
        return {run: 1.0 - (after / before) ** 2 for run, (before, after) in self.residual.items()}

    def to_dict(self, noise: float) -> dict[str, Any]:
        """As its JSON object; `noise` is that of the speed, rad/s."""
        values = {name: number.to_dict() for name, number in self.parameters.items()}
        return {
            "formula": self.text,
            "parameters": values,
            "explains": self.explains,
            "times_noise": {
                run: {"before": before / noise, "after": after / noise}
                for run, (before, after) in self.residual.items()
            },
            "evidence": self.evidence,
            "equivalent": self.equivalent,
            "has_form_of": list(self.effects),
        }


@dataclass(frozen=True)
class _Judged:
    """A formula, its evidence, and how badly it predicts rows to which it was not fitted, both in nats."""

    choice: Choice
    evidence: float
    misfit: float
    formula: Formula


def search(form: WeakForm, validation: WeakForm | None, *, j: float) -> list[Formula]:
    """The formulas for what remains, the most credible first; none where no simple one does.

    Of those that cannot be told from the most credible one the simplest comes first. Of formulas with the
    same physics, which differ by their curve alone, there is one.

    `form` and `validation` are the runs in weak form, `j` is the inertia (kg·m²).
    """
    run = Balance.of(form, j)
    if not run.total > 0.0:
        return []
    check = None if validation is None else validation.motion
    both_ways = any(reverses(moved) for moved in (form.motion, check) if moved is not None)
    choices, forms = candidates(run, both_ways)
    judged = [found for found in (_judged(run, check, choice, forms) for choice in choices) if found]
    return [x.formula for x in _told(judged)]


def _judged(run: Balance, check: Motion | None, choice: Choice, forms: int) -> _Judged | None:
    """The formula with what it predicts; None where it takes away too little.

    Before anything is measured each of as many `forms` of single terms is as likely as any other, and so is
    each sum of two.
    """
    sides = run.sides(choice)
    if sides is None:
        return None
    fit = run.fit(sides)
    prior = forms if len(choice.terms) == 1 else forms * (forms - 1) // 2
    evidence = fit.gain - run.cost(choice) - math.log(max(prior, 1))
    errors = {"recording": (run.form.motion, _held_out(run, choice))}
    if check is not None:
        errors["validation"] = (check, _predicted(run, choice, fit.strengths, check))
    residual = {}
    for name, (moved, after) in errors.items():
        if after is None:
            return None
        residual[name] = (_rms(_errors(moved, np.zeros_like(moved.t), run.j)), _rms(after))
    # Each free run is worth one independent value.
    before, left = residual[name]
    misfit = 0.5 * len(free_runs(moved.t)) * math.log((left / before) ** 2 + FORM**2)
    if check is not None:
        # The evidence of the recording is that of its windows.
        evidence -= misfit
    formula = _formula(run, choice, fit.strengths, residual, evidence)
    return _Judged(choice, evidence, misfit, formula) if min(formula.explains.values()) >= _LEAST else None


def _held_out(run: Balance, choice: Choice) -> Array | None:
    """The errors of the speed of a run, half of it predicted with the numbers of the other half."""
    moved = run.form.motion
    count = len(moved.t)
    windows = _half(run.form.starts + run.form.weights.shape[1] // 2, count)
    rows = _half(np.arange(count), count)
    errors = np.empty(count)
    for half in (0, 1):
        part = run.part(windows != half)
        sides = part.sides(choice)
        error = None if sides is None else _predicted(part, choice, part.fit(sides).strengths, moved)
        if error is None:
            return None
        errors[rows == half] = error[rows == half]
    return errors


def _half(rows: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    """The half of the run, 0 or 1, to which each row belongs."""
    halves: NDArray[np.intp] = rows * _STRETCHES // count % 2
    return halves


def _predicted(run: Balance, choice: Choice, strengths: Array, moved: Motion) -> Array | None:
    """The errors of the speed of a motion in free runs, with the inertia and the viscous friction of `run`.

    None where the inertia is not positive: such a rotor does not move by any law.
    """
    more_j, more_b = run.opened(choice, strengths)
    if run.j + more_j <= 0.0:
        return None
    return _errors(moved, choice.torque(strengths, moved) + more_b * moved.omega_m, run.j + more_j)


def _errors(moved: Motion, torque: Array, j: float) -> Array:
    """Measured minus predicted speed in free runs under a torque; an unknown load is free in each motion."""
    errors = centred(moved.t, moved.omega_m) - gained(moved.t, (moved.driving - torque) / j)
    if moved.load_open:
        constant = gained(moved.t, np.ones_like(moved.t))
        errors = errors - constant * float(constant @ errors) / float(constant @ constant)
    return errors


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _told(judged: Sequence[_Judged]) -> list[_Judged]:
    """The formulas that are told: one of each physics, and no sum that does no more than a part of it.

    A formula is left out where both the evidence and what it predicts speak for the first one.
    """
    judged = [x for x in judged if x.evidence > 0.0]
    alone: dict[str, float] = {}
    for x in judged:
        if len(x.choice.terms) == 1:
            kind = x.choice.terms[0][0].kind
            alone[kind] = max(x.evidence, alone.get(kind, -math.inf))
    needed = [
        x
        for x in judged
        if len(x.choice.terms) == 1
        or x.evidence > max(alone.get(kind, -math.inf) for kind in x.choice.kinds) + _APART
    ]
    best = max((x.evidence for x in needed), default=0.0)

    def order(x: _Judged) -> tuple[bool, int, float]:
        apart = best - x.evidence >= _APART
        return apart, 0 if apart else x.choice.count, -x.evidence

    told: list[_Judged] = []
    for x in sorted(needed, key=order):
        alike = best - x.evidence < _APART
        rival = not told or alike or x.misfit - told[0].misfit < _APART
        if rival and len(told) < _TOLD and all(x.choice.kinds != other.choice.kinds for other in told):
            told.append(replace(x, formula=replace(x.formula, equivalent=alike and bool(told))))
    return told


def _formula(
    run: Balance,
    choice: Choice,
    strengths: Array,
    residual: Mapping[str, tuple[float, float]],
    evidence: float,
) -> Formula:
    texts, effects, at = [], [], 0
    parameters: dict[str, Number] = {}
    errors = spread(run, choice, strengths)
    for number, (term, shape) in enumerate(choice.terms, 1):
        tail = str(number) if len(choice.terms) > 1 else ""
        names, own = {}, iter(errors[number - 1])
        effects.append(_effect(term, float(strengths[at])))
        for name, unit in term.strengths:
            names[name] = name + tail
            parameters[name + tail] = Number(float(strengths[at]), unit, next(own))
            at += 1
        for sought, x in zip(term.shapes, shape, strict=True):
            names[sought.name] = sought.name + tail
            parameters[sought.name + tail] = Number(float(x), sought.unit, next(own))
        texts.append(term.text.format(**names))
    if _STRIBECK in effects:
        # Its law holds the constant friction, too.
        effects = [_STRIBECK if name == "coulomb_friction" else name for name in effects]
    return Formula(" + ".join(texts), parameters, residual, evidence, False, tuple(effects))


def _effect(term: Term, strength: float) -> str | None:
    """The effect of the catalogue whose law a term has at this strength."""
    if term.effect is None:
        return None
    least = min(x["low"] for x in effect(term.effect)["parameters"] if x["strength"])
    return term.effect if strength >= 0.0 or least < 0.0 else None
