"""Differential equations of the drive, and an adaptive Runge-Kutta pair to integrate them.

States, in order: line flux linkages λ_ac, λ_bc (V·s), mechanical angle (rad) and speed (rad/s) of the rotor,
shaft twist (rad), speed of the load (rad/s), heat of winding and magnet (1 = steady at rated), DC link (V),
terminal currents a and b behind the leakage (A, iron loss only), current in the shorted turns (A), and three
integrals that steer nothing: electrical energy taken in, energy lost in resistances, energy given to the
shaft (J).

The integrator is the 5(4) pair of J. R. Dormand and P. J. Prince, J. Comput. Appl. Math. 6 (1980) 19.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from .coenergy import angles, solve_currents, torque

if TYPE_CHECKING:
    from .parameters import Parameters

N_STATES = 15
N_CONTROLLED = 12
TOLERANCE = 1e-9

# nodes, stages and error weights of the pair; the seventh stage is the fifth-order solution
C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
E = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


@njit(cache=True)
def terminal_currents(y: np.ndarray, p: Parameters, i_m: np.ndarray, i: np.ndarray) -> None:
    """Fill magnetising currents i_m and terminal currents i (each (3,), A) from the states."""
    solve_currents(y[0], y[1], p.n_p * y[2], 1.0 - p.psi_drop * y[7], p, i_m)
    if p.r_c > 0.0:
        i[0], i[1], i[2] = y[9], y[10], -y[9] - y[10]
        return
    # shorted turns oppose phase a; without a neutral the mean of the magnetomotive forces vanishes
    x = p.short_share * y[11]
    i[0], i[1], i[2] = i_m[0] + 2.0 / 3.0 * x, i_m[1] - x / 3.0, i_m[2] - x / 3.0


@njit(cache=True)
def leg_voltages(
    y: np.ndarray, v_d: float, v_q: float, hold: float, p: Parameters, i: np.ndarray, v: np.ndarray
) -> float:
    """Average voltages of the three legs against the DC midpoint into v (3,), in V; returns the DC power in
    W.

    v_d, v_q is the command in the frame of the *measured* angle.  `hold` is the angle (rad) at which it is
    frozen in the stator, or NaN: the legs then follow the rotor within the interval, which holds v_d, v_q in
    its frame.
    """
    angle = hold
    if math.isnan(hold):
        angle = p.n_p * y[2] + p.angle_offset + p.eccentricity * math.sin(y[2] + p.phase_ecc)
        angle -= p.n_p * y[3] * p.delay
    power = 0.0
    c, s, _c6, _s6 = angles(angle)
    for x in range(3):
        v[x] = (v_d * c[x] - v_q * s[x]) * (y[8] / p.v_dc)
        if x == 0:
            v[x] *= 1.0 - p.leg_loss
        power += v[x] * i[x]
        v[x] -= p.r_on * i[x]
        if p.v_err != 0.0:
            v[x] -= p.v_err * math.tanh(i[x] / p.i_th)
    return power


@njit(cache=True)
def mechanics(t: float, y: np.ndarray, tau_e: float, tau_load: float, p: Parameters, dy: np.ndarray) -> None:
    """Angle, speed and shaft derivatives for the air-gap torque tau_e and the load's torque tau_load, in
    N·m."""
    th, w = y[2], y[3]
    sign = math.tanh(w / p.w_smooth)
    friction = p.b * w + (p.tau_c + p.mu_load * abs(tau_e)) * sign + p.drag * w * abs(w)
    if p.tau_s != 0.0:
        friction += p.tau_s * math.exp(-((w / p.w_s) ** 2)) * sign
    if w > 0.0:
        friction += p.tau_c_pos * sign + p.b_pos * w
    else:
        friction += p.tau_c_neg * sign + p.b_neg * w
    if p.tau_rub != 0.0:
        # distance to the tight spot, the short way round
        away = th - p.place_rub
        away -= 2.0 * math.pi * np.rint(away / (2.0 * math.pi))
        friction += p.tau_rub * math.exp(-((away / p.width_rub) ** 2)) * sign
    if p.tau_hump != 0.0:
        friction += p.tau_hump * math.exp(-(((abs(w) - p.w_hump) / p.width_hump) ** 2)) * sign
    rotor, load = tau_e - friction, tau_load
    if p.tau_cog != 0.0:
        a = p.order_cog * th + p.phase_cog
        rotor += p.tau_cog * (math.cos(a) + p.second_cog * math.cos(2.0 * a))
    if p.tau_pul != 0.0:
        load += p.tau_pul * math.cos(p.order_pul * (th - y[4]) + p.phase_pul)
    if p.tau_var != 0.0:
        load += p.tau_var * math.sin(2.0 * math.pi * p.f_var * t + p.phase_var)
    dy[2], dy[4], dy[5] = w, 0.0, 0.0
    if p.locked != 0.0:
        dy[3] = 0.0
    elif p.j_load > 0.0:
        shaft = p.k_shaft * y[4] + p.d_shaft * (w - y[5])
        dy[3] = (rotor - shaft) / (p.j - p.j_load)
        dy[4] = w - y[5]
        dy[5] = (shaft - load) / p.j_load
    else:
        dy[3] = (rotor - load) / p.j


@njit(cache=True)
def derivative(
    t: float, y: np.ndarray, v_d: float, v_q: float, hold: float, tau_load: float, p: Parameters,
    i_m: np.ndarray, i: np.ndarray, v: np.ndarray, dy: np.ndarray,
) -> None:  # fmt: skip
    """dy/dt into dy (15,).  i_m, i, v (3,) are work space; i_m also starts the search for the currents."""
    terminal_currents(y, p, i_m, i)
    power = leg_voltages(y, v_d, v_q, hold, p, i, v)
    r = p.r_s * (1.0 + p.rs_rise * y[6])
    r_a, r_b, r_c = r * (1.0 + p.excess_a), r * (1.0 + p.excess_b), r * (1.0 + p.excess_c)
    if p.r_loose != 0.0:
        r_a += p.r_loose * max(0.0, math.sin(2.0 * math.pi * p.f_loose * t))
    taken_in = v[0] * i[0] + v[1] * i[1] + v[2] * i[2]
    fed = p.short_share * y[11]
    e_a, e_b, e_c = v[0] - r_a * (i[0] - fed), v[1] - r_b * i[1], v[2] - r_c * i[2]
    mean = (e_a + e_b + e_c) / 3.0
    lost = r_b * i[1] ** 2 + r_c * i[2] ** 2
    lost += r_a * ((1.0 - p.short_share) * i[0] ** 2 + p.short_share * (i[0] - y[11]) ** 2)
    dy[9], dy[10], dy[11] = 0.0, 0.0, 0.0
    if p.r_c > 0.0:
        u_a, u_b = p.r_c * (i[0] - i_m[0]), p.r_c * (i[1] - i_m[1])
        dy[9], dy[10] = (e_a - mean - u_a) / p.l_series, (e_b - mean - u_b) / p.l_series
        dy[0], dy[1] = 2.0 * u_a + u_b, u_a + 2.0 * u_b
        lost += (u_a**2 + u_b**2 + (u_a + u_b) ** 2) / p.r_c
    else:
        dy[0], dy[1] = e_a - e_c, e_b - e_c
    if p.short_share > 0.0:
        # the shorted coil leaks a tenth of its share of the main flux
        leak = 0.1 * p.short_share**2 * p.l_d
        turn = p.short_share * (e_a - mean + r_a * (i[0] - y[11]))
        dy[11] = (turn - p.short_r * y[11]) / leak
        lost += p.short_r * y[11] ** 2
    tau_e = torque(i_m, p.n_p * y[2], 1.0 - p.psi_drop * y[7], p)
    mechanics(t, y, tau_e, tau_load, p, dy)
    copper = (i[0] ** 2 + i[1] ** 2 + i[2] ** 2) / (1.5 * p.i_rated**2)
    dy[6] = (copper - y[6]) / p.rs_tau
    heat = (1.0 - p.psi_speed_share) * copper + p.psi_speed_share * (y[3] / p.w_rated) ** 2
    dy[7] = (heat - y[7]) / p.psi_tau
    dy[8] = 0.0
    if p.r_source > 0.0:
        dy[8] = ((p.v_dc - y[8]) / p.r_source - power / y[8]) / p.c_dc
    dy[12], dy[13], dy[14] = taken_in, lost, tau_e * y[3]


@njit(cache=True)
def scales(p: Parameters) -> np.ndarray:
    """Size of each state (15,), against which the integrator's error is judged."""
    s = np.ones(N_STATES)
    s[0] = s[1] = p.psi_m
    s[3] = s[5] = max(1.0, 0.1 * p.w_rated)
    s[8] = p.v_dc
    s[9] = s[10] = s[11] = p.i_rated
    return s


@njit(cache=True)
def advance(
    t: float, t_end: float, h: float, y: np.ndarray, v_d: float, v_q: float, hold: float, tau_load: float,
    p: Parameters, size: np.ndarray, i_m: np.ndarray, i: np.ndarray, v: np.ndarray, k: np.ndarray,
) -> float:  # fmt: skip
    """Integrate y from t to t_end in place; returns the step (s) to try next, or a negative number on
    failure.

    The command and the load are constant meanwhile.  k (7, 15) is work space.
    """
    derivative(t, y, v_d, v_q, hold, tau_load, p, i_m, i, v, k[0])
    trial = np.empty(N_STATES)
    span = t_end - t
    while t_end - t > 1e-12 * span:
        step = min(h, t_end - t)
        for s in range(1, 7):
            trial[:] = y
            for m in range(s):
                share = step * A[s, m]
                for n in range(N_STATES):
                    trial[n] += share * k[m, n]
            derivative(t + C[s] * step, trial, v_d, v_q, hold, tau_load, p, i_m, i, v, k[s])
        worst = 0.0
        for n in range(N_CONTROLLED):
            x = 0.0
            for s in range(7):
                x += E[s] * k[s, n]
            worst = max(worst, abs(step * x) / (TOLERANCE * (size[n] + abs(y[n]))))
        if not worst < math.inf:
            return -1.0
        grow = 5.0 if worst < 1e-5 else min(5.0, max(0.2, 0.9 * worst**-0.2))
        if worst <= 1.0:
            t += step
            y[:] = trial
            k[0] = k[6]
            # a step cut short by the end of the interval says nothing about the next one
            if step == h or grow < 1.0:
                h = step * grow
        else:
            h = step * grow
            if h < 1e-13:
                return -1.0
    return h
