"""The strongest peer: the whole swarm compiled by numba, particles side by side so that LLVM vectorises.

Also one long trajectory, and the residual that scipy.optimize.least_squares gets. Formulas are arranged so
that no division is left in a step, and everything is compiled with fastmath.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from window import (
    FASTEST,
    HIGH,
    INERTIA,
    ITERATIONS,
    LOW,
    PERIOD,
    POLE_PAIRS,
    PULL,
    TRUTH,
    Array,
    Job,
    stream,
    weight,
)

LANES = 16


@njit(fastmath=True, error_model="numpy", inline="always")
def slope(d, q, w, u_d, u_q, c):  # type: ignore[no-untyped-def]
    return (
        u_d - c[0] * d + c[2] * (w * q),
        u_q - c[1] * q - w * (c[3] * d + c[4]),
        q * (c[5] + c[6] * d) - c[7] * w - c[8],
    )


@njit(fastmath=True, error_model="numpy", inline="always")
def advance(d, q, w, u_d, u_q, c):  # type: ignore[no-untyped-def]
    h = PERIOD
    a1, b1, e1 = slope(d, q, w, u_d, u_q, c)
    a2, b2, e2 = slope(d + 0.5 * h * a1, q + 0.5 * h * b1, w + 0.5 * h * e1, u_d, u_q, c)
    a3, b3, e3 = slope(d + 0.5 * h * a2, q + 0.5 * h * b2, w + 0.5 * h * e2, u_d, u_q, c)
    a4, b4, e4 = slope(d + h * a3, q + h * b3, w + h * e3, u_d, u_q, c)
    s = h / 6
    return (
        d + s * (a1 + 2 * (a2 + a3) + a4),
        q + s * (b1 + 2 * (b2 + b3) + b4),
        w + s * (e1 + 2 * (e2 + e3) + e4),
    )


@njit(fastmath=True, error_model="numpy")
def prepare(p, out):  # type: ignore[no-untyped-def]
    r_s, l_d, l_q, psi_m, j, b, tau_load = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    kappa = 1.5 * POLE_PAIRS * POLE_PAIRS / j
    out[0], out[1], out[2], out[3], out[4] = r_s / l_d, r_s / l_q, l_q / l_d, l_d / l_q, psi_m / l_q
    out[5], out[6], out[7], out[8] = kappa * psi_m, kappa * (l_d - l_q), b / j, POLE_PAIRS / j * tau_load
    out[9], out[10] = 1 / l_d, 1 / l_q


@njit(fastmath=True, error_model="numpy")
def group(c, cost, w_speed, v_d, v_q, i_d, i_q, omega):  # type: ignore[no-untyped-def]
    """Costs of LANES particles with coefficients c of shape (11, LANES)."""
    d = np.empty(LANES)
    q = np.empty(LANES)
    w = np.empty(LANES)
    s = np.zeros(LANES)
    d[:], q[:], w[:] = i_d[0], i_q[0], omega[0]
    h = PERIOD
    for k in range(v_d.size):
        x, y, i_dk, i_qk, w_k = v_d[k], v_q[k], i_d[k], i_q[k], omega[k]
        for n in range(LANES):
            e_d, e_q, e_w = d[n] - i_dk, q[n] - i_qk, w_speed * (w[n] - w_k)
            s[n] += 1.5 * (e_d * e_d + e_q * e_q) + e_w * e_w
            u_d, u_q = x * c[9, n], y * c[10, n]
            a0, b0, e0 = d[n], q[n], w[n]
            a1 = u_d - c[0, n] * a0 + c[2, n] * (e0 * b0)
            b1 = u_q - c[1, n] * b0 - e0 * (c[3, n] * a0 + c[4, n])
            e1 = b0 * (c[5, n] + c[6, n] * a0) - c[7, n] * e0 - c[8, n]
            a, b, e = a0 + 0.5 * h * a1, b0 + 0.5 * h * b1, e0 + 0.5 * h * e1
            a2 = u_d - c[0, n] * a + c[2, n] * (e * b)
            b2 = u_q - c[1, n] * b - e * (c[3, n] * a + c[4, n])
            e2 = b * (c[5, n] + c[6, n] * a) - c[7, n] * e - c[8, n]
            a, b, e = a0 + 0.5 * h * a2, b0 + 0.5 * h * b2, e0 + 0.5 * h * e2
            a3 = u_d - c[0, n] * a + c[2, n] * (e * b)
            b3 = u_q - c[1, n] * b - e * (c[3, n] * a + c[4, n])
            e3 = b * (c[5, n] + c[6, n] * a) - c[7, n] * e - c[8, n]
            a, b, e = a0 + h * a3, b0 + h * b3, e0 + h * e3
            a4 = u_d - c[0, n] * a + c[2, n] * (e * b)
            b4 = u_q - c[1, n] * b - e * (c[3, n] * a + c[4, n])
            e4 = b * (c[5, n] + c[6, n] * a) - c[7, n] * e - c[8, n]
            d[n] = a0 + h / 6 * (a1 + 2 * (a2 + a3) + a4)
            q[n] = b0 + h / 6 * (b1 + 2 * (b2 + b3) + b4)
            w[n] = e0 + h / 6 * (e1 + 2 * (e2 + e3) + e4)
    cost[:] = s


@njit(fastmath=True, error_model="numpy")
def evaluate(points, costs, w_speed, v_d, v_q, i_d, i_q, omega):  # type: ignore[no-untyped-def]
    c = np.empty((11, LANES))
    column = np.empty(11)
    part = np.empty(LANES)
    for first in range(0, points.shape[0], LANES):
        count = min(LANES, points.shape[0] - first)
        for n in range(LANES):
            prepare(points[first + min(n, count - 1)], column)
            c[:, n] = column
        group(c, part, w_speed, v_d, v_q, i_d, i_q, omega)
        costs[first : first + count] = part[:count]


@njit
def swarm(low, high, places, pulls, fitted, rest, w_speed, v_d, v_q, i_d, i_q, omega):  # type: ignore[no-untyped-def]
    particles, dims = places.shape
    x = low + places * (high - low)
    v = np.zeros_like(x)
    fastest = FASTEST * (high - low)
    points = np.empty((particles, rest.size))
    points[:] = rest
    costs = np.empty(particles)
    own_cost = np.full(particles, np.inf)
    own = x.copy()
    best, best_cost = x[0].copy(), np.inf
    for generation in range(ITERATIONS + 1):
        if generation > 0:
            for n in range(particles):
                for k in range(dims):
                    r1, r2 = pulls[generation - 1, 0, n, k], pulls[generation - 1, 1, n, k]
                    to = (
                        INERTIA * v[n, k]
                        + PULL * r1 * (own[n, k] - x[n, k])
                        + PULL * r2 * (best[k] - x[n, k])
                    )
                    v[n, k] = min(max(to, -fastest[k]), fastest[k])
                    x[n, k] = min(max(x[n, k] + v[n, k], low[k]), high[k])
        for n in range(particles):
            for k in range(dims):
                points[n, fitted[k]] = x[n, k]
        evaluate(points, costs, w_speed, v_d, v_q, i_d, i_q, omega)
        for n in range(particles):
            if costs[n] < own_cost[n]:
                own_cost[n] = costs[n]
                own[n] = x[n]
        leader = np.argmin(own_cost)
        if own_cost[leader] < best_cost:
            best_cost = own_cost[leader]
            best[:] = own[leader]
    return best_cost


@njit(fastmath=True, error_model="numpy")
def trajectory(p, w_speed, v_d, v_q, i_d, i_q, omega):  # type: ignore[no-untyped-def]
    """Fitness of one parameter set on a recording of any length."""
    c = np.empty(11)
    prepare(p, c)
    d, q, w, s = i_d[0], i_q[0], omega[0], 0.0
    for k in range(v_d.size):
        e_d, e_q, e_w = d - i_d[k], q - i_q[k], w_speed * (w - omega[k])
        s += 1.5 * (e_d * e_d + e_q * e_q) + e_w * e_w
        d, q, w = advance(d, q, w, v_d[k] * c[9], v_q[k] * c[10], c)
    return s


@njit(fastmath=True, error_model="numpy")
def residual(values, fitted, rest, w_speed, v_d, v_q, i_d, i_q, omega):  # type: ignore[no-untyped-def]
    """Weighted residuals, shape (3 * samples,), of one parameter set."""
    p = rest.copy()
    for k in range(fitted.size):
        p[fitted[k]] = values[k]
    c = np.empty(11)
    prepare(p, c)
    d, q, w = i_d[0], i_q[0], omega[0]
    out = np.empty(3 * v_d.size)
    phases = 1.5**0.5
    for k in range(v_d.size):
        out[3 * k] = phases * (d - i_d[k])
        out[3 * k + 1] = phases * (q - i_q[k])
        out[3 * k + 2] = w_speed * (w - omega[k])
        d, q, w = advance(d, q, w, v_d[k] * c[9], v_q[k] * c[10], c)
    return out


def data(columns: dict[str, Array]) -> tuple[object, ...]:
    """Arguments behind the parameters of every function here."""
    return (weight(columns), *(columns[name] for name in ("v_d", "v_q", "i_d", "i_q", "omega_e")))


def run(job: Job, columns: dict[str, Array]) -> Callable[[], float]:
    """The whole swarm as one call."""
    places, pulls = stream(job)
    fitted = np.array(job.fitted)
    arguments = (LOW[fitted], HIGH[fitted], places, pulls, fitted, TRUTH, *data(columns))
    return lambda: float(swarm(*arguments))
