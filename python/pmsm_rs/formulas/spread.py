"""Standard errors of the numbers of a formula, by its linear form at the fit.

The windows of the balance overlap: they are worth less than their number, which widens the errors. The
residual beside the formula counts as noise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from .balance import Balance, Choice

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

WHY_NONE: Final = "the recording does not tell the numbers of this formula apart"
"""Why a number has no standard error."""
_STEP: Final = 1e-3
"""Step of the difference quotient, a share of the shape."""
_SINGULAR: Final = 1e-6
"""Ratio of singular values below which a direction is not determined, and share of a number in it."""


def spread(run: Balance, choice: Choice, strengths: Array) -> list[list[float | None]]:
    """The standard errors of each term: those of its strengths, then those of its shapes.

    A number that the run does not determine has None.
    """
    sides = run.sides(choice)
    sizes = [len(term.strengths) for term, _ in choice.terms]
    ends = np.cumsum(sizes)
    shapes = [(at, k) for at, (_, shape) in enumerate(choice.terms) for k in range(len(shape))]
    errors: list[float | None]
    if sides is None:
        errors = [None] * (len(strengths) + len(shapes))
    else:
        slopes = [_slope(run, choice, strengths[ends[at] - sizes[at] : ends[at]], at, k) for at, k in shapes]
        matrix = np.column_stack([sides.values, *slopes])
        left = run.target - sides.values @ strengths
        errors = _errors(matrix, float(left @ left) / run.worth)
    out = []
    for at in range(len(choice.terms)):
        own = errors[ends[at] - sizes[at] : ends[at]]
        bent = [error for (of, _), error in zip(shapes, errors[len(strengths) :], strict=True) if of == at]
        out.append([*own, *bent])
    return out


def _slope(run: Balance, choice: Choice, strengths: Array, at: int, k: int) -> Array:
    """How the torque of a term in the windows changes with one of its shapes, beside the open parameters."""
    term, shape = choice.terms[at]
    h = _STEP * abs(shape[k])
    ends = []
    for moved in (shape[k] + h, shape[k] - h):
        columns = term.columns(run.form.motion, (*shape[:k], moved, *shape[k + 1 :]))
        ends.append(run.form.integral(np.column_stack(columns) @ strengths))
    slope: Array = (ends[0] - ends[1]) / (2.0 * h)
    return slope - run.basis @ (run.basis.T @ slope)


def _errors(matrix: Array, noise: float) -> list[float | None]:
    """Square roots of the diagonal of the covariance; None for a number that `matrix` does not determine."""
    scale = np.linalg.norm(matrix, axis=0)
    if not np.isfinite(matrix).all():
        return [None] * len(scale)
    known = scale > 0.0
    _, s, v = np.linalg.svd(matrix[:, known] / scale[known], full_matrices=False)
    firm = s > _SINGULAR * max(float(s.max(initial=0.0)), 1e-300)
    squares = np.sum((v[firm] / s[firm, None]) ** 2, axis=0) * noise
    loose = np.sum(v[~firm] ** 2, axis=0) > _SINGULAR
    errors: list[float | None] = [None] * len(scale)
    for at, square, is_loose in zip(np.flatnonzero(known), squares, loose, strict=True):
        error = float(np.sqrt(square) / scale[at])
        errors[int(at)] = error if not is_loose and np.isfinite(error) and error > 0.0 else None
    return errors
