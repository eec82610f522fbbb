"""Differential equations of the drive, and an adaptive Runge-Kutta pair to integrate them.

States, in order: line flux linkages λ_ac, λ_bc (V·s), mechanical angle (rad) and speed (rad/s) of the rotor,
shaft twist (rad), speed of the load (rad/s), heat of winding and magnet (1 = steady at rated), DC link (V),
terminal currents a and b behind the leakage (A, iron loss only), current in the shorted turns (A), deflection
before sliding (rad), currents d and q of the sleeve (A), currents alpha and beta of the hysteresis (A), and
three integrals that steer nothing: electrical energy taken in, energy lost in resistances, energy given to
the shaft (J).

The integrator is the 5(4) pair of J. R. Dormand and P. J. Prince, J. Comput. Appl. Math. 6 (1980) 19.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from .coenergy import HALF_SQRT3, angles, solve_currents, torque
from .mechanics import mechanics, short_way

if TYPE_CHECKING:
    from .parameters import Parameters

N_STATES = 20
N_CONTROLLED = 17
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
    if p.r_sleeve > 0.0:
        # the sleeve's currents turn with the rotor and magnetise as the stator's do
        at = angles(p.n_p * y[2])
        for z in range(3):
            i[z] -= y[13] * at[0][z] - y[14] * at[1][z]
    if p.i_hyst > 0.0:
        i[0] += y[15]
        i[1] += -0.5 * y[15] + HALF_SQRT3 * y[16]
        i[2] += -0.5 * y[15] - HALF_SQRT3 * y[16]


@njit(cache=True)
def axis_fluxes(y: np.ndarray, theta: float) -> tuple[float, float]:
    """Flux linkages (V·s) along and across the magnet, which a common part of the phases does not change."""
    at = angles(theta)
    psi_d = 2.0 / 3.0 * (y[0] * at[0][0] + y[1] * at[0][1])
    return psi_d, -2.0 / 3.0 * (y[0] * at[1][0] + y[1] * at[1][1])


@njit(cache=True)
def rotor_torque(y: np.ndarray, i_m: np.ndarray, p: Parameters) -> float:
    """Torque (N·m) on the rotor: of the magnetising currents, less what sleeve currents give themselves."""
    tau = torque(i_m, p.n_p * y[2], 1.0 - p.psi_drop * y[7], p)
    if p.r_sleeve > 0.0:
        psi_d, psi_q = axis_fluxes(y, p.n_p * y[2])
        tau -= 1.5 * p.n_p * (psi_d * y[14] - psi_q * y[13])
    return tau


@njit(cache=True)
def angle_error(th: float, w: float, p: Parameters) -> float:
    """Measured minus true electrical angle (rad) at the mechanical angle th (rad) and speed w (rad/s)."""
    error = p.angle_offset + p.eccentricity * math.sin(th + p.phase_ecc)
    if p.skew_1 != 0.0 or p.skew_2 != 0.0:
        th_e = p.n_p * th
        error += p.skew_1 * math.sin(th_e + p.phase_skew_1) + p.skew_2 * math.sin(2.0 * th_e + p.phase_skew_2)
    if p.flaw != 0.0:
        error += p.flaw * math.exp(-((short_way(th - p.place_flaw) / p.width_flaw) ** 2))
    return error - p.n_p * w * (p.delay_angle + p.late * abs(w))


@njit(cache=True)
def angle_error_slope(th: float, p: Parameters) -> float:
    """Change of the angle's error with the mechanical angle th, in electrical rad per rad."""
    slope = p.eccentricity * math.cos(th + p.phase_ecc)
    if p.skew_1 != 0.0 or p.skew_2 != 0.0:
        th_e = p.n_p * th
        slope += p.n_p * p.skew_1 * math.cos(th_e + p.phase_skew_1)
        slope += 2.0 * p.n_p * p.skew_2 * math.cos(2.0 * th_e + p.phase_skew_2)
    if p.flaw != 0.0:
        away = short_way(th - p.place_flaw)
        slope -= 2.0 * p.flaw * away / p.width_flaw**2 * math.exp(-((away / p.width_flaw) ** 2))
    return slope


@njit(cache=True)
def leg_voltages(
    t: float, y: np.ndarray, v_d: float, v_q: float, hold: float, p: Parameters, i: np.ndarray, v: np.ndarray
) -> float:
    """Average voltages of the three legs against the DC midpoint into v (3,), in V; returns the DC power in
    W.

    v_d, v_q is the command in the frame of the *measured* angle.  `hold` is the angle (rad) at which it is
    frozen in the stator, or NaN: the legs then follow the rotor within the interval, which holds v_d, v_q in
    its frame.
    """
    angle = hold
    if math.isnan(hold):
        angle = p.n_p * y[2] + angle_error(y[2], y[3], p)
        angle -= p.n_p * y[3] * p.delay
    link = y[8] / p.v_dc
    if p.ripple != 0.0:
        # a rectified sine less its mean
        link *= 1.0 + p.ripple * (abs(math.sin(math.pi * p.f_ripple * t)) - 2.0 / math.pi)
    power = 0.0
    c, s, _c6, _s6 = angles(angle)
    for x in range(3):
        v[x] = (v_d * c[x] - v_q * s[x]) * link
        if x == 0:
            v[x] *= 1.0 - p.leg_loss
        power += v[x] * i[x]
        v[x] -= p.r_on * i[x]
        if p.v_err != 0.0:
            v[x] -= p.v_err * math.tanh(i[x] / p.i_th)
    return power


@njit(cache=True)
def derivative(
    t: float, y: np.ndarray, v_d: float, v_q: float, hold: float, tau_load: float, p: Parameters,
    i_m: np.ndarray, i: np.ndarray, v: np.ndarray, dy: np.ndarray,
) -> None:  # fmt: skip
    """dy/dt into dy (20,).  i_m, i, v (3,) are work space; i_m also starts the search for the currents."""
    terminal_currents(y, p, i_m, i)
    power = leg_voltages(t, y, v_d, v_q, hold, p, i, v)
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
    dy[13], dy[14], dy[15], dy[16] = 0.0, 0.0, 0.0, 0.0
    if p.r_sleeve > 0.0:
        # the rotor's frame sees the flux change less by its own turning
        at = angles(p.n_p * y[2])
        psi_d, psi_q = axis_fluxes(y, p.n_p * y[2])
        u_d = 2.0 / 3.0 * (dy[0] * at[0][0] + dy[1] * at[0][1]) + p.n_p * y[3] * psi_q
        u_q = -2.0 / 3.0 * (dy[0] * at[1][0] + dy[1] * at[1][1]) - p.n_p * y[3] * psi_d
        dy[13] = -(p.r_sleeve * y[13] + u_d) / p.l_sleeve
        dy[14] = -(p.r_sleeve * y[14] + u_q) / p.l_sleeve
        lost += 1.5 * p.r_sleeve * (y[13] ** 2 + y[14] ** 2)
    if p.i_hyst > 0.0:
        u_a, u_b = (2.0 * dy[0] - dy[1]) / 3.0, dy[1] / (2.0 * HALF_SQRT3)
        size = math.sqrt(u_a * u_a + u_b * u_b)
        dy[15] = (p.i_hyst * u_a - size * y[15]) / p.flux_hyst
        dy[16] = (p.i_hyst * u_b - size * y[16]) / p.flux_hyst
        lost += 1.5 * size * (y[15] ** 2 + y[16] ** 2) / p.i_hyst
    tau_e = rotor_torque(y, i_m, p)
    mechanics(t, y, tau_e, tau_load, p, dy)
    copper = (i[0] ** 2 + i[1] ** 2 + i[2] ** 2) / (1.5 * p.i_rated**2)
    dy[6] = (copper - y[6]) / p.rs_tau
    heat = (1.0 - p.psi_speed_share) * copper + p.psi_speed_share * (y[3] / p.w_rated) ** 2
    dy[7] = (heat - y[7]) / p.psi_tau
    dy[8] = 0.0
    if p.r_source > 0.0:
        dy[8] = ((p.v_dc - y[8]) / p.r_source - power / y[8]) / p.c_dc
    dy[17], dy[18], dy[19] = taken_in, lost, tau_e * y[3]


@njit(cache=True)
def scales(p: Parameters) -> np.ndarray:
    """Size of each state (20,), against which the integrator's error is judged."""
    s = np.ones(N_STATES)
    s[0] = s[1] = p.psi_m
    s[3] = s[5] = max(1.0, 0.1 * p.w_rated)
    s[8] = p.v_dc
    s[9] = s[10] = s[11] = p.i_rated
    s[12] = p.theta_dahl
    s[13] = s[14] = s[15] = s[16] = p.i_rated
    return s


@njit(cache=True)
def advance(
    t: float, t_end: float, h: float, y: np.ndarray, v_d: float, v_q: float, hold: float, tau_load: float,
    p: Parameters, size: np.ndarray, i_m: np.ndarray, i: np.ndarray, v: np.ndarray, k: np.ndarray,
) -> float:  # fmt: skip
    """Integrate y from t to t_end in place; returns the step (s) to try next, or a negative number on
    failure.

    The command and the load are constant meanwhile.  k (7, 20) is work space.
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
