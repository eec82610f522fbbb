"""The jobs that every peer does: data, bounds, and a swarm with a fixed stream of random numbers.

A motor is simulated at 100 kHz over 3300 samples (classical Runge-Kutta, voltage held from sample to sample)
and noise is added. The fitness is that of Liu, Liu & Cartes (2008), eq. (9): squared errors of the phase
currents, which at the measured angle are 3/2 of those of i_d and i_q, and of the speed times the weight w.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLES = 3300
PERIOD = 1e-5
POLE_PAIRS = 4.0
NAMES = ("r_s", "l_d", "l_q", "psi_m", "j", "b", "tau_load")
TRUTH = np.array([0.17, 1.9e-3, 1.9e-3, 0.27, 0.008, 0.00115, 3.0])
LOW = np.array([0.05, 1.0e-3, 1.0e-3, 0.10, 0.002, 1e-6, 1e-3])
HIGH = np.array([0.50, 4.0e-3, 4.0e-3, 0.50, 0.020, 0.01, 10.0])
START = (0.0, 2.0, 100.0)
ITERATIONS = 30
INERTIA, PULL, FASTEST = 0.8, 2.0, 0.2


@dataclass(frozen=True)
class Job:
    """How many particles, and which parameters they fit."""

    particles: int
    fitted: tuple[int, ...]


J1 = Job(10, (0, 6))
J2 = Job(1000, tuple(range(7)))


def slope(x: list[float], v: tuple[float, float], p: list[float]) -> list[float]:
    """Right-hand side of (1)-(3) for i_d, i_q, omega_e."""
    r_s, l_d, l_q, psi_m, j, b, tau_load = p
    i_d, i_q, w = x
    tau = 1.5 * POLE_PAIRS * (psi_m * i_q + (l_d - l_q) * i_d * i_q)
    return [
        (v[0] - r_s * i_d + w * l_q * i_q) / l_d,
        (v[1] - r_s * i_q - w * (l_d * i_d + psi_m)) / l_q,
        POLE_PAIRS / j * (tau - b * w / POLE_PAIRS - tau_load),
    ]


def measured(samples: int = SAMPLES) -> dict[str, Array]:
    """Columns of one run: t, v_d, v_q, i_d, i_q, omega_e, each of shape (samples,)."""
    t = np.arange(samples) * PERIOD
    cycle = t % (SAMPLES * PERIOD)
    v_d = 8 * np.sin(2 * np.pi * 110 * cycle + 0.3) - 4
    v_q = 45 + 25 * np.sin(2 * np.pi * 70 * cycle) + 15 * (cycle > 0.012) - 20 * (cycle > 0.022)
    x, p, run = list(START), [float(value) for value in TRUTH], np.empty((3, min(samples, SAMPLES)))
    for k in range(run.shape[1]):
        run[:, k] = x
        v = (float(v_d[k]), float(v_q[k]))
        k1 = slope(x, v, p)
        k2 = slope([a + 0.5 * PERIOD * d for a, d in zip(x, k1, strict=True)], v, p)
        k3 = slope([a + 0.5 * PERIOD * d for a, d in zip(x, k2, strict=True)], v, p)
        k4 = slope([a + PERIOD * d for a, d in zip(x, k3, strict=True)], v, p)
        x = [
            a + PERIOD / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
            for a, d1, d2, d3, d4 in zip(x, k1, k2, k3, k4, strict=True)
        ]
    noise = np.random.default_rng(7).standard_normal(run.shape) * np.array([[0.05], [0.05], [0.5]])
    noise[:, 0] = 0.0
    shown = run + noise
    repeats = -(-samples // run.shape[1])
    i_d, i_q, omega_e = (np.ascontiguousarray(np.tile(row, repeats)[:samples]) for row in shown)
    return {"t": t, "v_d": v_d, "v_q": v_q, "i_d": i_d, "i_q": i_q, "omega_e": omega_e}


def weight(columns: dict[str, Array]) -> float:
    """w of eq. (9): root mean square of the phase currents over that of the speed."""
    current = np.sqrt(1.5 * np.mean(columns["i_d"] ** 2 + columns["i_q"] ** 2))
    return float(current / np.sqrt(np.mean(columns["omega_e"] ** 2)))


def stream(job: Job, seed: int = 1) -> tuple[Array, Array]:
    """Random numbers of a swarm: places (particles, dims) and pulls (iterations, 2, particles, dims)."""
    rng = np.random.default_rng(seed)
    dims = len(job.fitted)
    return rng.random((job.particles, dims)), rng.random((ITERATIONS, 2, job.particles, dims))
