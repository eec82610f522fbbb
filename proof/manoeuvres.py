"""Manoeuvres: what the bench asks of the drive, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

import numpy as np
from numba import njit

from .parameters import Machine

LOADS = ("none", "known_constant", "measured", "unknown_constant", "unknown_piecewise", "locked")
KINDS = ("rich", "poor", "fast", "locked")


class KnownLoad(TypedDict):
    """load one of LOADS, load_value in N·m, breaks the rows at which an unknown load changes."""

    load: str
    load_value: float
    breaks: tuple[int, ...]


@dataclass(frozen=True)
class Manoeuvre:
    """References and load, each (n,).

    w_ref mechanical rad/s; i_d_ref A; i_q_add A, added to the speed controller's wish (the whole reference
    when the rotor is locked); tau_load N·m, opposing positive speed; load one of LOADS; w_start rad/s; settle
    rows at the front are run but not recorded; log_v_dc records the DC link where it is not constant;
    currents_alone leaves the speed uncontrolled, i_q_add being the whole reference.
    """

    kind: str
    load: str
    w_ref: np.ndarray
    i_d_ref: np.ndarray
    i_q_add: np.ndarray
    tau_load: np.ndarray
    w_start: float = 0.0
    settle: int = 0
    log_v_dc: bool = False
    currents_alone: bool = False

    @property
    def known_load(self) -> KnownLoad:
        """What a fit to the recorded rows is told of the load."""
        load = self.tau_load[self.settle :]
        steps = np.flatnonzero(np.diff(load)) + 1 if "unknown" in self.load else ()
        return {"load": self.load, "load_value": float(load[0]), "breaks": tuple(int(k) for k in steps)}

    @property
    def locked(self) -> bool:
        """Whether the rotor is held."""
        return self.load == "locked"


def steps(rng: np.random.Generator, n: int, shortest: int, longest: int) -> list[tuple[int, int]]:
    """Cut n samples into consecutive pieces of random length; the last one takes what is left."""
    out, at = [], 0
    while at < n:
        end = min(n, at + int(rng.integers(shortest, longest + 1)))
        if n - end < shortest:
            end = n
        out.append((at, end))
        at = end
    return out


@njit(cache=True)
def limit_slope(x: np.ndarray, first: float, per_sample: float) -> np.ndarray:
    """x (n,) followed no faster than per_sample, starting at `first`."""
    out, now = np.empty_like(x), first
    for k in range(len(x)):
        now += min(per_sample, max(-per_sample, x[k] - now))
        out[k] = now
    return out


def dither(
    rng: np.random.Generator, n: int, t_s: float, low: float, high: float, tones: int = 5
) -> np.ndarray:
    """Sum of sines (n,) of random frequency between low and high in Hz and random phase, of rms 1."""
    t = np.arange(n) * t_s
    f, phase = rng.uniform(low, high, tones), rng.uniform(0.0, 2.0 * np.pi, tones)
    return np.sqrt(2.0 / tones) * np.sin(2.0 * np.pi * np.outer(t, f) + phase).sum(axis=1)


def load_torque(rng: np.random.Generator, machine: Machine, n: int, load: str, level: float) -> np.ndarray:
    """Load torque (n,) in N·m of the kind `load`, of about `level` of the rated torque."""
    if load in ("none", "locked"):
        return np.zeros(n)
    tau = level * machine.tau_rated
    if load in ("known_constant", "unknown_constant"):
        return np.full(n, float(rng.choice([-1.0, 1.0])) * tau)
    out = np.zeros(n)
    for a, b in steps(rng, n, n // 6, n // 3):
        out[a:b] = tau * rng.uniform(-1.5, 1.5)
    return out


def make(
    machine: Machine, kind: str = "rich", load: str = "none", *, duration: float = 2.0, seed: int = 1
) -> Manoeuvre:
    """A manoeuvre of a kind from KINDS under a load from LOADS, lasting `duration` s.

    rich: speed steps and reversals, i_d steps, dither on both axes; poor: constant speed and load, i_d = 0;
    fast: quick reversals up to rated speed; locked: rotor held, current steps on both axes.  Raises
    ValueError for an unknown kind or load.
    """
    if kind not in KINDS or load not in LOADS or (kind == "locked") != (load == "locked"):
        raise ValueError(f"no manoeuvre {kind!r} under load {load!r}")
    rng = np.random.default_rng([seed, 77])
    fs, m = machine.f_sample, machine
    settle = int(0.4 * fs) if kind == "poor" else 0
    n = round(duration * fs) + settle
    w, i_d, i_q = np.zeros(n), np.zeros(n), np.zeros(n)
    if kind == "poor":
        w[:] = rng.uniform(0.35, 0.6) * m.w_rated
        tau = load_torque(rng, m, n, "none" if load == "none" else "known_constant", 0.3)
        return Manoeuvre(kind, load, w, i_d, i_q, tau, w_start=float(w[0]), settle=settle)
    piece = (0.05, 0.12) if kind == "fast" else (0.12, 0.3)
    for a, b in steps(rng, n, int(piece[0] * fs), int(piece[1] * fs)):
        i_d[a:b] = rng.uniform(-0.5, 0.15) * m.i_rated
        if kind == "locked":
            i_q[a:b] = rng.uniform(-0.8, 0.8) * m.i_rated
    if kind == "locked":
        i_d += 0.02 * m.i_rated * dither(rng, n, 1.0 / fs, 40.0, 250.0)
        return Manoeuvre(kind, load, w, i_d, i_q, np.zeros(n))
    sign = float(rng.choice([-1.0, 1.0]))
    low, high = (0.5, 1.0) if kind == "fast" else (0.08, 0.85)
    for number, (a, b) in enumerate(steps(rng, n, int(piece[0] * fs), int(1.4 * piece[1] * fs))):
        # two reversals out of three steps, so that both directions see speeding up and slowing down
        sign = -sign if number % 3 != 2 else sign
        w[a:b] = sign * rng.uniform(low, high) * m.w_rated
    slope = rng.uniform(0.5, 0.7) * m.tau_rated / m.j
    w = limit_slope(w, 0.0, slope / fs)
    i_d += 0.02 * m.i_rated * dither(rng, n, 1.0 / fs, 30.0, 250.0)
    i_q += 0.03 * m.i_rated * dither(rng, n, 1.0 / fs, 20.0, 150.0)
    return Manoeuvre(kind, load, w, i_d, i_q, load_torque(rng, m, n, load, 0.25))
