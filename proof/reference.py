"""The plain machine, fitted to a recording: how much an effect shows once every base parameter may adapt.

Sampled-data form of the dq equations, exact for a held voltage and a speed constant within the interval (its
mean):

    i' = M i + f,   M = [[−r_s/l_d, ω l_q/l_d], [−ω l_d/l_q, −r_s/l_q]],   f = (v_d/l_d, (v_q − ω ψ_m)/l_q)
    i_k+1 = e^{M T} i_k + M⁻¹ (e^{M T} − 1) f

and of j ω' = τ_e − b ω − τ_load, in free run within windows of 0.25 s from a fitted initial speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import least_squares
from scipy.signal import lfilter

WINDOW = 0.25


def park(a: np.ndarray, b: np.ndarray, c: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude-invariant Park transform of phase quantities (n,) at electrical angles theta (n,) in rad."""
    alpha, beta = (2.0 * a - b - c) / 3.0, (b - c) / np.sqrt(3.0)
    return alpha * np.cos(theta) + beta * np.sin(theta), beta * np.cos(theta) - alpha * np.sin(theta)


@njit(cache=True)
def chain(phi: np.ndarray, forced: np.ndarray, first: np.ndarray) -> np.ndarray:
    """x_k+1 = Φ_k x_k + g_k for Φ (n−1, 2, 2), g (n−1, 2), x_0 (2,); returns x (n, 2)."""
    x = np.empty((len(phi) + 1, 2))
    x[0] = first
    for k in range(len(phi)):
        x[k + 1, 0] = phi[k, 0, 0] * x[k, 0] + phi[k, 0, 1] * x[k, 1] + forced[k, 0]
        x[k + 1, 1] = phi[k, 1, 0] * x[k, 0] + phi[k, 1, 1] * x[k, 1] + forced[k, 1]
    return x


def currents(base: dict[str, float], log: dict[str, np.ndarray], t_s: float, first: np.ndarray) -> np.ndarray:
    """i_d, i_q (n, 2) in A of the plain machine from the state `first`, driven by logged voltage and
    speed."""
    r, ld, lq = base["r_s"], base["l_d"], base["l_q"]
    w = 0.5 * (log["omega_e"][1:] + log["omega_e"][:-1])
    m = np.empty((len(w), 2, 2))
    m[:, 0, 0], m[:, 0, 1], m[:, 1, 0], m[:, 1, 1] = -r / ld, w * lq / ld, -w * ld / lq, -r / lq
    half = 0.5 * (m[:, 0, 0] + m[:, 1, 1])
    det = m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] * m[:, 1, 0]
    root = np.sqrt((half**2 - det).astype(complex))
    root[root == 0.0] = 1e-9
    grow = np.exp(half * t_s)
    even, odd = (grow * np.cosh(root * t_s)).real, (grow * np.sinh(root * t_s) / root).real
    phi = odd[:, None, None] * m
    phi[:, 0, 0] += even - odd * half
    phi[:, 1, 1] += even - odd * half
    f = np.stack([log["v_d"][:-1] / ld, (log["v_q"][:-1] - w * base["psi_m"]) / lq], axis=1)
    forced = np.linalg.solve(m, np.einsum("kij,kj->ki", phi - np.eye(2), f)[:, :, None])[:, :, 0]
    return chain(phi, forced, first)


def torque_of(base: dict[str, float], i_d: np.ndarray, i_q: np.ndarray) -> np.ndarray:
    """Torque (n,) in N·m of the plain machine at currents (n,) in A."""
    return 1.5 * base["n_p"] * (base["psi_m"] * i_q + (base["l_d"] - base["l_q"]) * i_d * i_q)


def speed_residual(
    base: dict[str, float], drive_torque: np.ndarray, omega_e: np.ndarray, t_s: float, n_p: int
) -> np.ndarray:
    """Measured minus free-running electrical speed (n,) in rad/s, window by window.

    drive_torque (n,) in N·m is the air-gap torque minus what is known of the load.
    """
    out = np.empty_like(omega_e)
    a = np.exp(-base["b"] * t_s / base["j"])
    gain = n_p * t_s / base["j"] * (1.0 - 0.5 * base["b"] * t_s / base["j"])
    size = round(WINDOW / t_s)
    for at in range(0, len(omega_e), size):
        y = omega_e[at : at + size]
        u = drive_torque[at : at + size]
        x = np.zeros_like(y)
        x[1:] = lfilter([gain], [1.0, -a], 0.5 * (u[1:] + u[:-1]))
        decay = a ** np.arange(len(y))
        start = decay @ (y - x) / (decay @ decay)
        out[at : at + size] = y - x - start * decay
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
    i_d, i_q = park(log["i_a"], log["i_b"], log["i_c"], log["theta_e"])
    measured = np.stack([i_d, i_q], axis=1)
    names = ["r_s", "l_d", "l_q", "psi_m"] if refit else []

    def electrical(x: np.ndarray) -> np.ndarray:
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
