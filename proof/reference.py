"""The plain machine, fitted to a recording: how much an effect shows once every base parameter may adapt.

Sampled-data form of the dq equations, exact for a held voltage and a speed constant within the interval (its
mean):

    i' = M i + f,   M = [[−r_s/l_d, ω l_q/l_d], [−ω l_d/l_q, −r_s/l_q]],   f = (v_d/l_d, (v_q − ω ψ_m)/l_q)
    i_k+1 = e^{M T} i_k + M⁻¹ (e^{M T} − 1) f

and of j ω' = τ_e − b ω − τ_load, in free run within windows of 0.25 s from a fitted initial speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import least_squares

WINDOW = 0.25


def park(a: np.ndarray, b: np.ndarray, c: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude-invariant Park transform of phase quantities (n,) at electrical angles theta (n,) in rad."""
    alpha, beta = (2.0 * a - b - c) / 3.0, (b - c) / np.sqrt(3.0)
    return alpha * np.cos(theta) + beta * np.sin(theta), beta * np.cos(theta) - alpha * np.sin(theta)


def axes(log: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """i_d, i_q (n,) in A of a log that has them, or its phase currents; two add up to the third."""
    if "i_d" in log:
        return log["i_d"], log["i_q"]
    third = log["i_c"] if "i_c" in log else -log["i_a"] - log["i_b"]
    return park(log["i_a"], log["i_b"], third, log["theta_e"])


@njit(cache=True, error_model="numpy")
def chain(
    r: float, ld: float, lq: float, psi: float, v_d: np.ndarray, v_q: np.ndarray, omega: np.ndarray,
    t_s: float, first: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """i_d, i_q (n, 2) in A from `first` (2,), driven by voltages (V) and electrical speed (rad/s), each
    (n,)."""
    i = np.empty((len(omega), 2))
    i[0] = first
    half = -0.5 * (r / ld + r / lq)
    grow = math.exp(half * t_s)
    for k in range(len(omega) - 1):
        w = 0.5 * (omega[k] + omega[k + 1])
        dd, dq, qd, qq = -r / ld, w * lq / ld, -w * ld / lq, -r / lq
        det = dd * qq - dq * qd
        # e^{M T} = even + odd (M − half), by the roots half ± √(half² − det) of M
        square = half * half - det
        root = math.sqrt(abs(square))
        if square > 0.0:
            even, odd = grow * math.cosh(root * t_s), grow * math.sinh(root * t_s) / root
        elif square < 0.0:
            even, odd = grow * math.cos(root * t_s), grow * math.sin(root * t_s) / root
        else:
            even, odd = grow, grow * t_s
        phi_dd, phi_qq = even + odd * (dd - half), even + odd * (qq - half)
        phi_dq, phi_qd = odd * dq, odd * qd
        f_d, f_q = v_d[k] / ld, (v_q[k] - w * psi) / lq
        g_d = (phi_dd - 1.0) * f_d + phi_dq * f_q
        g_q = phi_qd * f_d + (phi_qq - 1.0) * f_q
        i[k + 1, 0] = phi_dd * i[k, 0] + phi_dq * i[k, 1] + (qq * g_d - dq * g_q) / det
        i[k + 1, 1] = phi_qd * i[k, 0] + phi_qq * i[k, 1] + (dd * g_q - qd * g_d) / det
    return i


def currents(base: dict[str, float], log: dict[str, np.ndarray], t_s: float, first: np.ndarray) -> np.ndarray:
    """i_d, i_q (n, 2) in A of the plain machine from the state `first`, driven by logged voltage and
    speed."""
    return chain(
        base["r_s"], base["l_d"], base["l_q"], base["psi_m"], log["v_d"], log["v_q"], log["omega_e"], t_s,
        first,
    )  # fmt: skip


def torque_of(base: dict[str, float], i_d: np.ndarray, i_q: np.ndarray) -> np.ndarray:
    """Torque (n,) in N·m of the plain machine at currents (n,) in A."""
    return 1.5 * base["n_p"] * (base["psi_m"] * i_q + (base["l_d"] - base["l_q"]) * i_d * i_q)


def speed_residual(
    base: dict[str, float],
    drive_torque: np.ndarray,
    omega_e: np.ndarray,
    t_s: float,
    n_p: int,
    window: float = WINDOW,
) -> np.ndarray:
    """Measured minus free-running electrical speed (n,) in rad/s, window by window of so many seconds.

    drive_torque (n,) in N·m is the air-gap torque minus what is known of the load.
    """
    fall = base["b"] * t_s / base["j"]
    gain = n_p * t_s / base["j"] * (1.0 - 0.5 * fall)
    return windows(math.exp(-fall), gain, drive_torque, omega_e, round(window / t_s))


@njit(cache=True)
def windows(a: float, gain: float, torque: np.ndarray, omega: np.ndarray, size: int) -> np.ndarray:
    """ω (n,) less x_k+1 = a x_k + gain (u_k + u_k+1)/2, windows of `size` rows, each from its best start."""
    out = np.empty_like(omega)
    for at in range(0, len(omega), size):
        end = min(at + size, len(omega))
        x, decay, over, under = 0.0, 1.0, 0.0, 0.0
        for k in range(at, end):
            if k > at:
                x = a * x + gain * 0.5 * (torque[k - 1] + torque[k])
                decay *= a
            out[k] = omega[k] - x
            over += decay * out[k]
            under += decay * decay
        start = over / under
        for k in range(at, end):
            out[k] -= start
            start *= a
    return out


@dataclass(frozen=True)
class Fit:
    """Base parameters, load levels (N·m) of the given pieces, and residuals (n,) per channel in its unit."""

    base: dict[str, float]
    load_levels: list[float]
    residual: dict[str, np.ndarray]

    def rms(self) -> dict[str, float]:
        """Root mean square of each channel's residual."""
        return {k: float(np.sqrt(np.mean(v**2))) for k, v in self.residual.items()}


def fit_plain(
    start: dict[str, float],
    log: dict[str, np.ndarray],
    t_s: float,
    *,
    load: str = "none",
    load_value: float = 0.0,
    breaks: tuple[int, ...] = (),
    shapes: tuple[np.ndarray, ...] = (),
    refit: bool = True,
) -> Fit:
    """Fit the plain machine to a recording, electrical part first, from `start` (Machine's base names and
    n_p).

    load and load_value are what is known of the load; `breaks` are the rows at which an unknown load changes;
    `shapes`, each (n,), are torques against the motion whose size is fitted, too.
    refit=False keeps the base parameters and estimates initial values and load levels only.
    """
    base, n_p = dict(start), int(start["n_p"])
    i_d, i_q = axes(log)
    measured = np.stack([i_d, i_q], axis=1)
    names = ["r_s", "l_d", "l_q", "psi_m"] if refit else []

    def electrical(x: np.ndarray) -> np.ndarray:
        # a step may be tried that leads nowhere; what it leaves is not finite, and it is refused
        with np.errstate(over="ignore"):
            trial = {**base, **{k: base[k] * np.exp(x[2 + c]) for c, k in enumerate(names)}}
        return (measured - currents(trial, log, t_s, x[:2])).ravel()

    found = least_squares(
        electrical, np.concatenate([measured[0], np.zeros(len(names))]), x_scale="jac", method="lm"
    )
    rest = electrical(found.x).reshape(-1, 2)
    base.update({k: base[k] * float(np.exp(found.x[2 + c])) for c, k in enumerate(names)})
    residual = {"i_d": rest[:, 0], "i_q": rest[:, 1]}
    if load == "locked":
        return Fit(base, [], residual)
    torque = torque_of(base, i_d, i_q)
    if load == "known_constant":
        torque = torque - load_value
    elif load == "measured":
        torque = torque - log["tau_m"]
    edges = [0, *breaks, len(torque)] if load.startswith("unknown") else []
    names = ["j", "b"] if refit else []

    def mechanical(x: np.ndarray) -> np.ndarray:
        trial = {**base, **{k: base[k] * np.exp(x[c]) for c, k in enumerate(names)}}
        u = torque.copy()
        for c in range(len(edges) - 1):
            u[edges[c] : edges[c + 1]] -= x[len(names) + c]
        for c, shape in enumerate(shapes, 1):
            u -= x[-c] * shape
        return speed_residual(trial, u, log["omega_e"], t_s, n_p)

    x = np.zeros(len(names) + max(len(edges) - 1, 0) + len(shapes))
    if len(x):
        x = least_squares(mechanical, x, x_scale="jac", method="lm").x
    residual["omega_e"] = mechanical(x)
    base.update({k: base[k] * float(np.exp(x[c])) for c, k in enumerate(names)})
    return Fit(base, [float(v) for v in x[len(names) : len(x) - len(shapes)]], residual)
