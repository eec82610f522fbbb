"""What each effect of the catalogue adds to a recording at unit size, to first order: regression columns.

An effect is a voltage that acts beside the logged one, a current that is measured beside the machine's, a
torque beside the motor's, or a speed that is measured beside the rotor's.  Voltages pass through the plain
machine's equations and torques through its motion, so that columns and residuals are of one kind.  Effects
with shapes have a few variants.  An elastic shaft has no such column.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from .reference import axes, chain, speed_residual, torque_of

PHASES = np.exp(-2j * np.pi / 3.0 * np.arange(3))


@dataclass(frozen=True)
class Signals:
    """A log in the rotor's frame, each (n,): complex voltage v (V) and current i (A), angles theta_e and
    theta_m (rad), speed w electrical (rad/s), tau (N·m) the plain machine's torque; t_s s; base its
    parameters."""

    v: np.ndarray
    i: np.ndarray
    theta_e: np.ndarray
    theta_m: np.ndarray
    w: np.ndarray
    tau: np.ndarray
    t_s: float
    base: dict[str, float]

    @property
    def n_p(self) -> float:
        """Pole pairs."""
        return self.base["n_p"]


@dataclass(frozen=True)
class Piece:
    """What an effect of unit size adds; None adds nothing.  v, i complex (n,), tau and w (n,)."""

    v: np.ndarray | None = None
    i: np.ndarray | None = None
    tau: np.ndarray | None = None
    w: np.ndarray | None = None


def signals(log: dict[str, np.ndarray], t_s: float, base: dict[str, float]) -> Signals:
    """The signals of a log."""
    i_d, i_q = axes(log)
    theta = np.unwrap(log["theta_e"])
    tau = torque_of(base, i_d, i_q)
    v = log["v_d"] + 1j * log["v_q"]
    return Signals(v, i_d + 1j * i_q, theta, theta / base["n_p"], log["omega_e"], tau, t_s, base)


def in_phase(s: Signals, x: np.ndarray, phase: int) -> np.ndarray:
    """A quantity (n,) of one phase alone as a vector in the rotor's frame."""
    return 2.0 / 3.0 * x * np.conj(PHASES[phase]) * np.exp(-1j * s.theta_e)


def of_phase(s: Signals, x: np.ndarray, phase: int) -> np.ndarray:
    """The phase's part (n,) of a vector in the rotor's frame."""
    return (x * np.exp(1j * s.theta_e) * PHASES[phase]).real


def flux(s: Signals, psi: np.ndarray) -> Piece:
    """An additional flux linkage (V·s), complex (n,): its induced voltage and its torque."""
    rate = np.diff(psi, prepend=psi[0]) / s.t_s
    return Piece(v=-rate - 1j * s.w * psi, tau=1.5 * s.n_p * (np.conj(psi) * s.i).imag)


def turned(s: Signals, angle: np.ndarray, rate: np.ndarray | None = None) -> Piece:
    """An error of the measured angle (rad), and of the measured speed (rad/s)."""
    return Piece(v=1j * angle * s.v, i=-1j * angle * s.i, w=rate)


def heat(x: np.ndarray, tau: float, t_s: float) -> np.ndarray:
    """x (n,) through a first-order lag from zero."""
    a = float(np.exp(-t_s / tau))
    return lfilter([1.0 - a], [1.0, -a], x)


def waves(x: np.ndarray, orders: tuple[float, ...], of: Callable[[np.ndarray], Piece]) -> list[Piece]:
    """Cosine and sine of every order of an angle (n,)."""
    return [of(f(k * x)) for k in orders for f in (np.cos, np.sin)]


def library(s: Signals) -> dict[str, list[list[Piece]]]:
    """effect -> variants -> pieces whose sizes are free."""
    w = s.w / s.n_p
    sign = np.tanh(w / (0.01 * np.abs(w).max() + 1e-9))
    t = np.arange(len(w)) * s.t_s
    e = s.v - s.base["r_s"] * s.i
    warm = np.abs(s.i) ** 2 / max(float(np.mean(np.abs(s.i) ** 2)), 1e-12)
    size = float(np.abs(s.i).max())
    phases = [of_phase(s, s.i, k) for k in range(3)]
    one = np.ones_like(w)
    six = np.exp(6j * s.theta_e)

    def drag(x: np.ndarray) -> Piece:
        return Piece(tau=-x)

    lost = sum(in_phase(s, -np.tanh(phases[k] / (0.02 * size)), k) for k in range(3))
    late = -np.diff(s.v, prepend=s.v[0]) - 1j * s.w * s.t_s * s.v
    cogging = tuple(2.0 * s.n_p * k for k in (1, 2, 3))
    return {
        "coulomb_friction": [[drag(sign)]],
        "stribeck_friction": [[drag(sign), drag(sign * np.exp(-((w / x) ** 2)))] for x in width(w)],
        "asymmetric_friction": [[drag(sign * (w > 0.0)), drag(sign * (w <= 0.0))]],
        "load_dependent_friction": [[drag(sign * np.abs(s.tau))]],
        "quadratic_drag": [[drag(w * np.abs(w))]],
        "cogging_torque": [waves(s.theta_m, cogging, drag)],
        "cogging_asymmetry": [waves(s.theta_m, (float(k), 2.0 * s.n_p), drag) for k in range(6, 97, 3)],
        "load_torque_pulsation": [waves(s.theta_m, (1.0, 2.0, 3.0), drag)],
        "time_varying_load": [waves(2.0 * np.pi * f * t, (1.0,), drag) for f in np.arange(1.0, 9.0, 0.5)],
        "back_emf_harmonics": [[Piece(v=s.w * c * x) for x in (six.real, six.imag) for c in (1.0, 1j)]],
        "saturation_d": [[flux(s, -(s.i.real**3) + 0j)]],
        "saturation_q": [[flux(s, -1j * s.i.imag**3)]],
        "cross_saturation": [[flux(s, -(s.i.imag**2) - 2j * s.i.real * s.i.imag)]],
        "inductance_harmonics": [[flux(s, s.i * six.real), flux(s, np.conj(s.i * six))]],
        "rs_thermal_drift": [[Piece(v=-heat(warm, x, s.t_s) * s.i)] for x in (0.5, 1.0, 2.0)],
        "magnet_thermal_drift": [[flux(s, -heat(warm, x, s.t_s) + 0j)] for x in (0.5, 1.0, 2.0)],
        "iron_loss": [[Piece(i=e)]],
        "dead_time": [[Piece(v=lost)]],
        "voltage_delay": [[Piece(v=late)]],
        "dc_link_sag": [[Piece(v=-(np.conj(s.v) * s.i).real * s.v)]],
        "phase_resistance_imbalance": [[Piece(v=-in_phase(s, phases[k], k)) for k in (0, 1)]],
        "inter_turn_short": [[Piece(i=in_phase(s, of_phase(s, e, 0), 0))]],
        "current_offset": [[Piece(i=in_phase(s, one, k)) for k in (0, 1)]],
        "current_gain_imbalance": [[Piece(i=in_phase(s, phases[k], k)) for k in (0, 1)]],
        "encoder_angle_offset": [[turned(s, one)]],
        "encoder_delay": [[turned(s, -s.w)]],
        "encoder_eccentricity": [
            [
                turned(s, np.sin(s.theta_m), w * np.cos(s.theta_m)),
                turned(s, np.cos(s.theta_m), -w * np.sin(s.theta_m)),
            ]
        ],
    }


def width(w: np.ndarray) -> tuple[float, ...]:
    """Stribeck speeds that are tried, rad/s."""
    fast = float(np.abs(w).max()) + 1e-9
    return 0.03 * fast, 0.1 * fast


def respond(s: Signals, piece: Piece, window: float) -> dict[str, np.ndarray]:
    """What a piece adds to measured minus modelled i_d, i_q (A) and omega_e (rad/s), each (n,)."""
    n, base = len(s.w), s.base
    i = np.zeros(n, complex)
    if piece.v is not None:
        out = chain(
            base["r_s"], base["l_d"], base["l_q"], 0.0, np.ascontiguousarray(piece.v.real),
            np.ascontiguousarray(piece.v.imag), s.w, s.t_s, np.zeros(2),
        )  # fmt: skip
        i = i + out[:, 0] + 1j * out[:, 1]
    tau = np.zeros(n) if piece.tau is None else piece.tau
    if piece.i is not None:
        i = i + piece.i
        # the torque is taken from measured currents, which are too high by piece.i
        slope = base["psi_m"] * piece.i.imag + (base["l_d"] - base["l_q"]) * (s.i * piece.i).imag
        tau = tau - 1.5 * s.n_p * slope
    w = np.zeros(n) if piece.w is None else piece.w
    # the residual of a speed that is the response to the torque
    omega = -speed_residual(base, tau, -w, s.t_s, int(s.n_p), window)
    return {"i_d": i.real, "i_q": i.imag, "omega_e": omega}
