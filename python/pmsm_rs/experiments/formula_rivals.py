"""Formulas for an unknown torque as rivals: their torques along a motion, and what tells them apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..formulas.free_run import centred, gained
from ..formulas.reading import Torque, torque
from ..formulas.weak_form import Motion
from ..model import Model
from .comparison import Separation, separation_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .bench import Bench, Trial
    from .references import References

    Array = NDArray[np.float64]

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
        moved_by: Array = gained(trial.t, values) * factor
        return moved_by

    own = rival.torque.at(moved)
    columns = [centred(trial.t, trial.omega_m) * n_p / noise * _INERTIA]
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
