"""Closed-loop drive around the machine: encoder, current sensors, PI cascades, one sample of delay.

Row k of the log holds what was sampled at t_k and the command acting on [t_k, t_k+1), computed from the
samples taken at t_k−1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from .coenergy import angles, axis_currents, field_energy, magnet_flux
from .dynamics import (
    N_STATES,
    advance,
    angle_error,
    angle_error_slope,
    rotor_torque,
    scales,
    terminal_currents,
)

if TYPE_CHECKING:
    from .parameters import Parameters

LOG = ("v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e")
TRUTH = (
    "i_a",
    "i_b",
    "i_c",
    "theta_m",
    "omega_m",
    "tau_e",
    "v_dc",
    "heat",
    "e_in",
    "e_lost",
    "e_shaft",
    "e_field",
    "seen_a",
    "seen_b",
    "seen_c",
    "seen_w",
    "twist",
    "omega_load",
)
# times the rated current: no drive gets there, a plant does whose flux no current makes
RUNAWAY = 10.0


@njit(cache=True)
def measure(
    y: np.ndarray,
    i: np.ndarray,
    noise_i: np.ndarray,
    noise_w: float,
    lsb_i: float,
    lsb_theta: float,
    t_s: float,
    p: Parameters,
    memory: np.ndarray,
    row: np.ndarray,
    seen: np.ndarray,
) -> None:
    """Fill columns 2.. of a log row: currents (A), wrapped electrical angle (rad), electrical speed (rad/s).

    memory (2, 3): the phase currents of the last sample and what the filter held then; it is brought up to
    date.  seen (4,): currents and speed as the sensors have them before noise and quantisation.
    """
    keep = math.exp(-t_s / p.lag_i) if p.lag_i > 0.0 else 0.0
    gains, offsets = (p.g_a, p.g_b, p.g_c), (p.o_a, p.o_b, p.o_c)
    for x in range(3):
        held, at = memory[1, x], i[x]
        if p.lag_i > 0.0:
            at = keep * held + (1.0 - keep) * 0.5 * (i[x] + memory[0, x])
        memory[0, x], memory[1, x] = i[x], at
        # phases b and c are sampled later than the row says, on the line through the last two samples
        at += (at - held) * x * p.skew_i / t_s
        at *= 1.0 - p.bow_i * at * at
        seen[x] = (1.0 + gains[x]) * at + offsets[x]
        row[2 + x] = seen[x] + noise_i[x]
        if lsb_i > 0.0:
            row[2 + x] = lsb_i * np.rint(row[2 + x] / lsb_i)
    theta = p.n_p * y[2] + angle_error(y[2], y[3], p)
    if lsb_theta > 0.0:
        theta = lsb_theta * np.rint(theta / lsb_theta)
    row[5] = theta - 2.0 * math.pi * np.rint(theta / (2.0 * math.pi))
    seen[3] = y[3] * (p.n_p + angle_error_slope(y[2], p))
    row[6] = seen[3] + noise_w


@njit(cache=True)
def control(
    row: np.ndarray,
    w_ref: float,
    i_d_ref: float,
    i_q_add: float,
    torque_mode: bool,
    integral: np.ndarray,
    gains: np.ndarray,
    out: np.ndarray,
) -> None:
    """PI speed and current control on one row of measurements; the voltage command (V) into out (2,).

    gains: kp_w, ki_w, kp_d, kp_q, ki_i, l_d, l_q, psi_m, i_max, v_max, t_s, n_p.  In torque mode i_q_add is
    the whole i_q reference (A).  integral (3,) holds the integrators.
    """
    kp_w, ki_w, kp_d, kp_q, ki_i = gains[0], gains[1], gains[2], gains[3], gains[4]
    i_max, v_max, t_s = gains[8], gains[9], gains[10]
    i_d, i_q = axis_currents(row[2:5], row[5])
    w = row[6]
    room = math.sqrt(max(i_max**2 - i_d_ref**2, 0.0))
    i_q_ref = i_q_add
    if not torque_mode:
        error = w_ref - w / gains[11]
        wish = kp_w * error + integral[0] + i_q_add
        i_q_ref = min(room, max(-room, wish))
        if wish == i_q_ref or error * wish < 0.0:
            integral[0] += ki_w * t_s * error
    e_d, e_q = i_d_ref - i_d, i_q_ref - i_q
    v_d = kp_d * e_d + integral[1] - w * gains[6] * i_q
    v_q = kp_q * e_q + integral[2] + w * (gains[5] * i_d + gains[7])
    size = math.sqrt(v_d**2 + v_q**2)
    if size > v_max:
        v_d *= v_max / size
        v_q *= v_max / size
    else:
        integral[1] += ki_i * t_s * e_d
        integral[2] += ki_i * t_s * e_q
    out[0], out[1] = v_d, v_q


@njit(cache=True)
def run(
    p: Parameters,
    start: np.ndarray,
    w_ref: np.ndarray,
    i_d_ref: np.ndarray,
    i_q_add: np.ndarray,
    torque_mode: bool,
    tau_load: np.ndarray,
    noise_i: np.ndarray,
    noise_w: np.ndarray,
    lsb_i: float,
    lsb_theta: float,
    gains: np.ndarray,
    stator_hold: bool,
    log_command: bool,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Run the drive over all n samples.

    start: electrical angle and mechanical speed at t = 0.  References and load (n,), noise_i (n, 3) in A,
    noise_w (n,) in rad/s.  stator_hold freezes the command in the stator for an interval, as a real modulator
    does; log_command then logs it as it is, and not its mean in the rotor's frame.  Returns the log (n, 7)
    and the truth (n, 18), columns as in LOG and TRUTH, and the number of rows
    up to where the integration broke down or a current ran away.
    """
    n, t_s = len(w_ref), gains[10]
    log, truth = np.zeros((n, 7)), np.zeros((n, 18))
    y, size = np.zeros(N_STATES), scales(p)
    k = np.zeros((7, N_STATES))
    i_m, i, v, memory = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((2, 3))
    integral, command = np.zeros(3), np.zeros(2)
    if p.j_load > 0.0:
        # without a current the load drives both masses, the rotor through the shaft: let go, it would ring
        y[4] = tau_load[0] * (1.0 - p.j_load / p.j) / p.k_shaft
        y[4] += 0.5 * p.gap * np.sign(tau_load[0])
    y[2], y[3], y[5], y[8] = start[0] / p.n_p, start[1], start[1], p.v_dc
    # flux of the magnet alone: no current flows at t = 0
    at = angles(start[0])
    psi_c = magnet_flux(2, at, p)
    y[0], y[1] = magnet_flux(0, at, p) - psi_c, magnet_flux(1, at, p) - psi_c
    whole = math.floor(p.delay / t_s + 1e-9)
    late = max(p.delay - whole * t_s, 0.0)
    h = t_s
    for m in range(n):
        terminal_currents(y, p, i_m, i)
        measure(y, i, noise_i[m], noise_w[m], lsb_i, lsb_theta, t_s, p, memory, log[m], truth[m, 12:16])
        log[m, 0], log[m, 1] = command[0], command[1]
        truth[m, 0], truth[m, 1], truth[m, 2] = i[0], i[1], i[2]
        if not max(abs(i[0]), abs(i[1]), abs(i[2])) <= RUNAWAY * p.i_rated:
            return log, truth, m
        truth[m, 3], truth[m, 4] = y[2], y[3]
        truth[m, 16], truth[m, 17] = y[4], y[5]
        truth[m, 5] = rotor_torque(y, i_m, p)
        truth[m, 6], truth[m, 7] = y[8], y[6]
        truth[m, 8], truth[m, 9], truth[m, 10] = y[17], y[18], y[19]
        magnet = 1.0 - p.psi_drop * y[7]
        truth[m, 11] = field_energy(i_m, y[0], y[1], p.n_p * y[2], magnet, p)
        truth[m, 11] += 0.5 * p.l_series * (i[0] ** 2 + i[1] ** 2 + i[2] ** 2)
        truth[m, 11] += 0.05 * p.short_share**2 * p.l_d * y[11] ** 2
        if p.r_sleeve > 0.0:
            truth[m, 11] += 0.75 * p.l_sleeve * (y[13] ** 2 + y[14] ** 2)
        if p.i_hyst > 0.0:
            truth[m, 11] += 0.75 * p.flux_hyst / p.i_hyst * (y[15] ** 2 + y[16] ** 2)
        hold = math.nan
        if stator_hold:
            # angle expected in the middle of the interval, from the sample the command was computed from
            past = log[max(m - 1, 0)]
            hold = past[5] + 1.5 * t_s * past[6]
            half = 0.5 * t_s * past[6]
            if half != 0.0 and not log_command:
                log[m, 0] *= math.sin(half) / half
                log[m, 1] *= math.sin(half) / half
        t = m * t_s
        if late > 0.0:
            old = log[max(m - whole - 1, 0)]
            h = advance(t, t + late, h, y, old[0], old[1], hold, tau_load[m], p, size, i_m, i, v, k)
        now = log[max(m - whole, 0)] if whole > 0 else command
        if h > 0.0:
            h = advance(t + late, t + t_s, h, y, now[0], now[1], hold, tau_load[m], p, size, i_m, i, v, k)
        if h <= 0.0:
            return log, truth, m
        control(log[m], w_ref[m], i_d_ref[m], i_q_add[m], torque_mode, integral, gains, command)
    return log, truth, n
