"""The equation of motion in weak form: integrated over short windows, so that no signal is differentiated.

With a smooth weight phi that is zero at both ends of a window, j·dω_m/dt = τ_e − τ_load − τ_known − f becomes

    ∫ phi·f dt = ∫ phi·(τ_e − τ_load − τ_known) dt + j·∫ phi'·ω_m dt.

The left side is linear in the factors of a torque f over speed, angle, motor torque and time; the right side
is known. Source: Messenger & Bortz, "Weak SINDy", Multiscale Modeling & Simulation 19 (2021) 1474.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..export.program import evaluate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..model import Model

    Array = NDArray[np.float64]

# Windows of a run at most, and rows of a window at least.
_WINDOWS, _ROWS = 600, 8
# A step in time longer than this many periods is a gap.
_GAP = 1.5
# Rows that are used at most; of longer runs the means of equal runs of rows are.
_MOST = 60_000


@dataclass(frozen=True)
class Motion:
    """What moves, one entry per row: time (s), mechanical speed (rad/s) and angle (rad), motor torque, and
    the torque that no known cause takes, acceleration included (N·m). `load_open` says whether a constant
    load is unknown.
    """

    t: Array
    omega_m: Array
    theta_m: Array
    tau_e: Array
    driving: Array
    load_open: bool


@dataclass(frozen=True)
class WeakForm:
    """Windows of a motion: `weights` are phi·dt by window and row within it, `slopes` phi'·dt, `starts` the
    first row of each window.
    """

    motion: Motion
    starts: NDArray[np.intp]
    weights: Array
    slopes: Array

    def integral(self, values: Array) -> Array:
        """∫ phi·values dt of each window."""
        integrals: Array = np.einsum("wk,wk->w", self.weights, self._cut(values))
        return integrals

    def momentum(self) -> Array:
        """∫ phi'·ω_m dt of each window."""
        integrals: Array = np.einsum("wk,wk->w", self.slopes, self._cut(self.motion.omega_m))
        return integrals

    def _cut(self, values: Array) -> Array:
        rows: Array = values[self.starts[:, None] + np.arange(self.weights.shape[1])]
        return rows


def motion(
    model: Model, trace: Mapping[str, Array], *, load: Array | float | None, tau_e: Array | None = None
) -> Motion | None:
    """The motion of a run as its `trace` holds it (see `Diagnosis.traces`), under a load torque (N·m), None
    for an unknown constant one. `tau_e` is the motor torque where it was recorded; else it comes from the
    currents.

    None where the trace has no speed, and no currents or no angle.
    """
    if "omega_e_measured" not in trace:
        return None
    told = model.equations()
    t = np.asarray(trace["t"])
    omega_m = np.asarray(trace["omega_e_measured"]) / told["n_p"]
    theta_m = np.asarray(trace["op_theta_m"]) if "op_theta_m" in trace else _turned(t, omega_m)
    if tau_e is None:
        if not {"op_i_d", "op_i_q"} <= set(trace):
            return None
        tau_e = _torque(told, t, trace["op_i_d"], trace["op_i_q"], omega_m, theta_m)
    at: dict[str, Any] = {"omega_m": omega_m, "theta_m": theta_m, "tau_e": tau_e, "t": t}
    lost = sum(evaluate(told["torque"], at).values(), np.zeros_like(t))
    b = model.specification["base"]["b"]
    driving = tau_e - lost - b * omega_m - (0.0 if load is None else load)
    return Motion(t, omega_m, theta_m, tau_e, driving, load is None)


def _torque(
    told: Mapping[str, Any], t: Array, i_d: Array, i_q: Array, omega_m: Array, theta_m: Array
) -> Array:
    """Motor torque of currents by the model, N·m."""
    begin: dict[str, Any] = {
        "i_d": i_d,
        "i_q": i_q,
        "omega_m": omega_m,
        "theta_m": theta_m,
        "tau_load": 0.0,
        "t": t,
    }
    state = evaluate(told["start"], begin)
    return np.broadcast_to(evaluate(told["output"], {"t": t, **state})["tau_e"], t.shape)


def _turned(t: Array, omega_m: Array) -> Array:
    """The angle through which the rotor has turned, rad."""
    steps = 0.5 * (omega_m[1:] + omega_m[:-1]) * np.diff(t)
    return np.concatenate([[0.0], np.cumsum(steps)])


def thinned(moved: Motion) -> Motion:
    """The means of equal runs of rows where there are more than 60 000 rows: time and memory stay bounded."""
    each = -(-len(moved.t) // _MOST)
    if each == 1:
        return moved

    def mean(values: Array) -> Array:
        whole = len(values) // each * each
        means: Array = values[:whole].reshape(-1, each).mean(axis=1)
        return means

    return Motion(
        mean(moved.t),
        mean(moved.omega_m),
        mean(moved.theta_m),
        mean(moved.tau_e),
        mean(moved.driving),
        moved.load_open,
    )


def windows(moved: Motion) -> WeakForm | None:
    """Windows that overlap by half and cross no gap; None where the run is too short for any."""
    moved = thinned(moved)
    t = moved.t
    count = min(_WINDOWS, len(t) // _ROWS)
    if count < 2:
        return None
    rows = max(_ROWS, 2 * (len(t) // count)) + 1
    starts = np.arange(0, len(t) - rows + 1, max(1, rows // 2))
    if len(starts) == 0:
        return None
    times = t[starts[:, None] + np.arange(rows)]
    steps = np.diff(times, axis=1)
    whole = steps.max(axis=1) <= _GAP * np.median(np.diff(t))
    times, steps, starts = times[whole], steps[whole], starts[whole]
    if len(starts) < 2:
        return None
    length = times[:, -1:] - times[:, :1]
    at = np.pi * (times - times[:, :1]) / length
    cell = np.zeros_like(times)
    cell[:, :-1] += 0.5 * steps
    cell[:, 1:] += 0.5 * steps
    return WeakForm(moved, starts, np.sin(at) ** 2 * cell, np.sin(2.0 * at) * np.pi / length * cell)
