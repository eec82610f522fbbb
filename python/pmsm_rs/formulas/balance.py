"""The balance of torques beside a sum of terms, and how likely it makes that sum.

The motor torque answers to what is missing: at a steady speed it equals the friction, whatever its cause. A
term in τ_e then stands on both sides of the balance, and k·τ_e with k = 1 closes that of any motion: the
regressor is endogenous. So the likelihood is that of the motor torque that a motion took, and not that of the
residual. The change of variables brings the factor |1 − ∂f/∂τ_e| for each window. A term that only scales the
motor torque gains ln 1/(1 − k) per window by its smaller residual and loses just as much by the factor. It
keeps a gain where motoring and braking differ, as they do under friction that grows with the load.

Such friction is passive, k ≥ 0, and it does not lock the rotor, ∂f/∂τ_e < 1: else no motor torque would have
moved it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .terms import Term
from .weak_form import Motion, WeakForm

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Windows overlap by half, so that they are worth less than their number.
_INDEPENDENT = 0.75
# Share of its amplitude by which the form of a simple formula is uncertain, as for effects of the catalogue:
# what is smaller is no evidence for another form.
FORM = 0.02
# What is smaller, as a share, is rounding.
_NOTHING = 1e-9
# Step of a difference quotient, a share of the largest motor torque.
_STEP = 1e-3
# Steps towards the most likely strengths at most, and the gain in nats at which they end.
_MOST, _SETTLED = 50, 1e-6


@dataclass(frozen=True)
class Choice:
    """Terms of a sum with their shapes."""

    terms: tuple[tuple[Term, tuple[float, ...]], ...]

    def columns(self, moved: Motion) -> list[Array]:
        """The torque of each strength at 1, along a motion."""
        return [column for term, shape in self.terms for column in term.columns(moved, shape)]

    def torque(self, strengths: Array, moved: Motion) -> Array:
        """The torque along a motion, N·m."""
        torque: Array = np.column_stack(self.columns(moved)) @ strengths
        return torque

    @property
    def count(self) -> int:
        """Numbers that it has."""
        return sum(term.count for term, _ in self.terms)

    @property
    def loaded(self) -> bool:
        """Whether it depends on the motor torque."""
        return any(term.loaded for term, _ in self.terms)

    @property
    def kinds(self) -> frozenset[str]:
        """The kinds of its terms."""
        return frozenset(term.kind for term, _ in self.terms)


@dataclass(frozen=True)
class Sides:
    """A sum in the windows of a run. `values` are the integrals of its columns with what the open parameters
    can do taken out. `slopes` are the changes of the columns with the motor torque.
    """

    values: Array
    slopes: Array

    def beside(self, other: Sides) -> Sides:
        """Both sums together."""
        return Sides(np.hstack([self.values, other.values]), np.hstack([self.slopes, other.slopes]))


@dataclass(frozen=True)
class Fit:
    """The most likely strengths of a sum, and the log-likelihood over that of no torque, nats."""

    strengths: Array
    gain: float


@dataclass(frozen=True)
class Balance:
    """A run in weak form at the inertia `j`: its left sides, and these with what the base parameters and the
    load can do taken out.
    """

    form: WeakForm
    j: float
    nuisance: Array
    basis: Array
    whole: Array
    target: Array

    @classmethod
    def of(cls, form: WeakForm, j: float) -> Balance:
        """The balance of a run."""
        moved = form.motion
        whole = form.integral(moved.driving) + j * form.momentum()
        nuisance = [form.momentum(), form.integral(moved.omega_m)]
        if moved.load_open:
            nuisance.append(form.integral(np.ones_like(moved.t)))
        basis = orthonormal(np.column_stack(nuisance))
        return cls(form, j, np.column_stack(nuisance), basis, whole, whole - basis @ (basis.T @ whole))

    def part(self, windows: NDArray[np.bool_]) -> Balance:
        """The balance of some of the windows."""
        form = self.form
        kept = replace(
            form, starts=form.starts[windows], weights=form.weights[windows], slopes=form.slopes[windows]
        )
        return Balance.of(kept, self.j)

    @property
    def total(self) -> float:
        """What there is to explain."""
        return float(self.target @ self.target)

    @property
    def worth(self) -> float:
        """Independent windows."""
        return _INDEPENDENT * len(self.target)

    def sides(self, choice: Choice) -> Sides | None:
        """The sum in the windows; None where it is not finite, or nothing beside the open parameters."""
        columns = choice.columns(self.form.motion)
        values = np.column_stack([self.form.integral(column) for column in columns])
        if not np.isfinite(values).all():
            return None
        cleared = values - self.basis @ (self.basis.T @ values)
        cleared[:, np.linalg.norm(cleared, axis=0) <= _NOTHING * np.linalg.norm(values, axis=0)] = 0.0
        if not cleared.any():
            return None
        slopes = self._slopes(choice) if choice.loaded else np.zeros_like(cleared)
        return Sides(cleared, slopes)

    def _slopes(self, choice: Choice) -> Array:
        """The change of each column with the motor torque, a mean of each window."""
        moved = self.form.motion
        h = _STEP * (float(np.abs(moved.tau_e).max()) or 1.0)
        raised = choice.columns(replace(moved, tau_e=moved.tau_e + h))
        lowered = choice.columns(replace(moved, tau_e=moved.tau_e - h))
        each = [self.form.integral((a - b) / (2.0 * h)) for a, b in zip(raised, lowered, strict=True)]
        slopes: Array = np.column_stack(each) / self.form.integral(np.ones_like(moved.t))[:, None]
        return slopes

    def likelihood(self, left: float) -> float:
        """Log-likelihood of a residual over that of all, nats, of unknown noise."""
        return 0.5 * self.worth * math.log(self.total / (max(left, 0.0) + FORM**2 * self.total))

    def fit(self, sides: Sides) -> Fit:
        """The most likely strengths."""
        scale = np.linalg.norm(sides.values, axis=0)
        scale[scale == 0.0] = 1.0
        values, slopes = sides.values / scale, sides.slopes / scale
        loaded = np.any(slopes != 0.0, axis=0)
        y, factor = self.target, 0.0
        strengths = np.zeros(values.shape[1])
        if loaded.any():
            rest = orthonormal(values[:, ~loaded])
            own = values[:, loaded] - rest @ (rest.T @ values[:, loaded])
            strengths[loaded], factor = self._of_torque(y - rest @ (rest.T @ y), own, slopes[:, loaded])
            y = y - values[:, loaded] @ strengths[loaded]
        if not loaded.all():
            strengths[~loaded] = np.linalg.lstsq(values[:, ~loaded], y, rcond=1e-9)[0]
        left = self.target - values @ strengths
        return Fit(strengths / scale, self.likelihood(float(left @ left)) + factor)

    def _of_torque(self, y: Array, own: Array, slopes: Array) -> tuple[Array, float]:
        """The most likely strengths of terms in the motor torque, and the logarithm of their factor.

        Gauss-Newton steps that climb, from no such friction on, within what is passive and does not lock.
        """
        n = self.worth

        def valued(a: Array) -> tuple[float, float]:
            free = 1.0 - slopes @ a
            if free.min() <= 0.0:
                return -math.inf, -math.inf
            left, factor = y - own @ a, n * float(np.log(free).mean())
            return self.likelihood(float(left @ left)) + factor, factor

        a = np.zeros(own.shape[1])
        best, factor = valued(a)
        for _ in range(_MOST):
            left = y - own @ a
            size = float(left @ left) + FORM**2 * self.total
            each = slopes / (1.0 - slopes @ a)[:, None]
            uphill = own.T @ left / size - each.mean(axis=0)
            curve = own.T @ own / size + each.T @ each / len(each)
            step = np.linalg.lstsq(curve, uphill, rcond=1e-12)[0]
            for shorter in 0.5 ** np.arange(30):
                there = np.maximum(a + shorter * step, 0.0)
                found, told = valued(there)
                if found > best:
                    break
            else:
                break
            settled, a, best, factor = found - best < _SETTLED, there, found, told
            if settled:
                break
        return a, factor

    def evidence(self, choice: Choice) -> float:
        """The evidence of a sum over none, nats (Schwarz, Ann. Statist. 6 (1978) 461)."""
        sides = self.sides(choice)
        return -math.inf if sides is None else self.fit(sides).gain - self.cost(choice)

    def cost(self, choice: Choice) -> float:
        """What the numbers of a sum cost, nats."""
        return 0.5 * choice.count * math.log(self.worth)

    def opened(self, choice: Choice, strengths: Array) -> tuple[float, float]:
        """What the inertia (kg·m²) and the viscous friction (N·m·s) gain beside the torque of a sum.

        The inertia of the answer is right to within its own size: a run at steady speed does not show it.
        """
        y = self.whole - self.form.integral(choice.torque(strengths, self.form.motion))
        left = y - self.basis @ (self.basis.T @ y)
        noise = math.sqrt(max(float(left @ left), FORM**2 * self.total) / self.worth)
        prior = np.zeros((1, self.nuisance.shape[1]))
        prior[0, 0] = noise / self.j
        matrix = np.vstack([self.nuisance, prior])
        scale = np.linalg.norm(matrix, axis=0)
        scale[scale == 0.0] = 1.0
        found = np.linalg.lstsq(matrix / scale, np.concatenate([y, [0.0]]), rcond=1e-12)[0] / scale
        return -float(found[0]), float(found[1])


def orthonormal(columns: Array) -> Array:
    """An orthonormal basis of the columns; directions of no size are left out."""
    sizes = np.linalg.norm(columns, axis=0)
    kept: Array = columns[:, sizes > 0.0] / sizes[sizes > 0.0]
    if not kept.shape[1]:
        return kept
    u, s, _ = np.linalg.svd(kept, full_matrices=False)
    basis: Array = u[:, s > _NOTHING]
    return basis
