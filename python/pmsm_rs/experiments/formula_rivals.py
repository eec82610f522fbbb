"""Formulas for an unknown torque as rivals: their torques along a motion, and what tells them apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..formulas.reading import Torque, torque
from ..formulas.weak_form import Motion
from ..model import Model
from .comparison import Separation, separation_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .bench import Bench, Trial
    from .references import References

    Array = NDArray[np.float64]

# The speed is compared in free runs of so many s, as in the diagnosis.
_WINDOW = 0.25
# Rounds in which torque and motion settle: the torque of one round drives the motion of the next.
_ROUNDS = 3
# Step of a difference quotient and spread of a number, shares of the value.
_STEP, _SPREAD = 1e-3, 1.0
# A nameplate inertia is right to a fifth.
_INERTIA = 0.2


@dataclass(frozen=True)
class FormulaRival:
    """A formula in question beside the named effects of `model`."""

    name: str
    model: Model
    torque: Torque


def of(answer: Mapping[str, Any]) -> list[FormulaRival]:
    """The formulas of an answer that cannot be told from the first; all, where none of them is as good.

    Fewer than two where there is nothing to tell apart.
    """
    told = list(answer.get("formulas") or ())
    alike = told[:1] + [entry for entry in told[1:] if entry["equivalent"]]
    chosen = alike if len(alike) > 1 else told
    data = answer["model"]
    named = Model({**data, "specification": {**data["specification"], "map": []}})
    return [FormulaRival(f"τ = {entry['formula']}", named, torque(entry)) for entry in chosen]


def run(bench: Bench, rival: FormulaRival, references: References) -> Trial:
    """The manoeuvre under the torque of a formula. Raises PmsmError where the drive cannot run it."""
    trial = bench.run(rival.model, references)
    for _ in range(_ROUNDS - 1):
        tau = rival.torque.at(motion(trial)) + bench.limits.load_torque
        trial = bench.run(rival.model, references, {"t": trial.t, "value": tau})
    return trial


def motion(trial: Trial) -> Motion:
    """The motion of a trial."""
    return Motion(trial.t, trial.omega_m, trial.theta_m, trial.tau_e, trial.tau_e, False)


def separation(
    truth: FormulaRival, rival: FormulaRival, trial: Trial, *, noise: float, load_open: bool
) -> Separation:
    """The residual of `rival` in the speed of the trial of `truth`; `noise` is that of the speed (rad/s,
    electrical).

    The rival adjusts its numbers, the inertia, the viscous friction and an unknown constant load.
    """
    moved = motion(trial)
    specification = rival.model.specification
    j, n_p = specification["base"]["j"], specification["scales"]["n_p"]
    factor = n_p / j / noise

    def speed(values: Array) -> Array:
        moved_by: Array = _run_free(trial.t, values) * factor
        return moved_by

    own = rival.torque.at(moved)
    columns = [_centred(trial.t, trial.omega_m) * n_p / noise * _INERTIA]
    b = max(float(np.abs(trial.tau_e).max()), 1e-12) / max(float(np.abs(trial.omega_m).max()), 1e-12)
    columns.append(speed(b * trial.omega_m))
    if load_open:
        columns.append(speed(np.full_like(trial.t, float(np.abs(trial.tau_e).max()))))
    for k, value in enumerate(rival.torque.values):
        h = _STEP * abs(value) or _STEP
        values = list(rival.torque.values)
        values[k] += h
        slope = (rival.torque.at(moved, tuple(values)) - own) / h
        columns.append(speed(slope * _SPREAD * (abs(value) or 1.0)))
    matrix = np.column_stack(columns)
    y = speed(truth.torque.at(moved) - own)
    whole = np.vstack([matrix, np.eye(matrix.shape[1])])
    step = np.linalg.lstsq(whole, np.concatenate([y, np.zeros(matrix.shape[1])]), rcond=1e-12)[0]
    return separation_of(truth.name, rival.name, {"omega_e": y - matrix @ step})


def _pieces(t: Array) -> Sequence[NDArray[np.intp]]:
    number = np.floor((t - t[0]) / _WINDOW).astype(int)
    return np.split(np.arange(len(t)), np.flatnonzero(np.diff(number)) + 1)


def _run_free(t: Array, values: Array) -> Array:
    """Integral of the values over each window, its mean taken out as the initial speed is estimated."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(t)
    return _centred(t, np.concatenate([[0.0], np.cumsum(steps)]))


def _centred(t: Array, values: Array) -> Array:
    out = np.empty_like(values)
    for rows in _pieces(t):
        out[rows] = values[rows] - values[rows].mean()
    return out
