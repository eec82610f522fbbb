"""What the plant's own equations leave in a log that drives them: whether a case can be solved.

Currents run free over the whole log, driven by the logged voltage and the measured angle and speed.  The
speed runs free within windows of 0.25 s from the true state, driven by the torque of those currents and the
true load.  All parameters are true.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from .coenergy import angles, magnet_flux
from .drive import measure
from .dynamics import (
    N_STATES,
    advance,
    angle_error,
    angle_error_slope,
    rotor_torque,
    scales,
    terminal_currents,
)
from .effects import Effects, build
from .manoeuvres import Manoeuvre
from .mechanics import mechanics
from .reference import WINDOW, axes

if TYPE_CHECKING:
    from .parameters import Machine, Parameters
    from .plant import Run

# Runge-Kutta steps of the motion per row
SUBSTEPS = 2
HALF_SQRT3 = 0.5 * math.sqrt(3.0)


@njit(cache=True)
def turn_field(y: np.ndarray, angle: float) -> None:
    """Turn fluxes and what else stands in the stator by an electrical angle in rad, in place."""
    c, s = math.cos(angle), math.sin(angle)
    for a, b, lines in ((0, 1, True), (9, 10, False), (15, 16, False)):
        if lines:
            alpha, beta = (2.0 * y[a] - y[b]) / 3.0, y[b] / (2.0 * HALF_SQRT3)
        elif a == 9:
            alpha, beta = y[a], (y[a] + 2.0 * y[b]) / (2.0 * HALF_SQRT3)
        else:
            alpha, beta = y[a], y[b]
        alpha, beta = c * alpha - s * beta, s * alpha + c * beta
        if lines:
            y[a], y[b] = 1.5 * alpha + HALF_SQRT3 * beta, 2.0 * HALF_SQRT3 * beta
        elif a == 9:
            y[a], y[b] = alpha, -0.5 * alpha + HALF_SQRT3 * beta
        else:
            y[a], y[b] = alpha, beta


@njit(cache=True)
def electrical(
    p: Parameters, v: np.ndarray, theta: np.ndarray, omega: np.ndarray, t_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Phase currents as sensors have them (n, 3) in A and torque (n,) in N·m, from a machine without current.

    v (n, 2) V commanded; theta (n,) rad and omega (n,) rad/s mechanical, as measured less the sensor's error.
    """
    n = len(theta)
    out, tau = np.zeros((n, 3)), np.zeros(n)
    y, size, k = np.zeros(N_STATES), scales(p), np.zeros((7, N_STATES))
    i_m, i, legs, memory = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((2, 3))
    row, seen, silence = np.zeros(7), np.zeros(4), np.zeros(3)
    at = angles(p.n_p * theta[0])
    psi_c = magnet_flux(2, at, p)
    y[0], y[1], y[8] = magnet_flux(0, at, p) - psi_c, magnet_flux(1, at, p) - psi_c, p.v_dc
    y[2] = theta[0]
    whole = math.floor(p.delay / t_s + 1e-9)
    late = max(p.delay - whole * t_s, 0.0)
    h = t_s
    for m in range(n):
        # the rotor's frame goes on where it was: what the measured angle jumps, the field jumps
        turn_field(y, p.n_p * (theta[m] - y[2]))
        y[2], y[3] = theta[m], omega[m]
        terminal_currents(y, p, i_m, i)
        measure(y, i, silence, 0.0, 0.0, 0.0, t_s, p, memory, row, seen)
        out[m] = seen[:3]
        tau[m] = rotor_torque(y, i_m, p)
        if m == n - 1:
            break
        y[3] = 0.5 * (omega[m] + omega[m + 1])
        t = m * t_s
        if late > 0.0:
            old = v[max(m - whole - 1, 0)]
            h = advance(t, t + late, h, y, old[0], old[1], math.nan, 0.0, p, size, i_m, i, legs, k)
        now = v[max(m - whole, 0)]
        if h > 0.0:
            h = advance(t + late, t + t_s, h, y, now[0], now[1], math.nan, 0.0, p, size, i_m, i, legs, k)
        if h <= 0.0:
            out[m + 1 :] = math.nan
            break
    return out, tau


@njit(cache=True)
def motion(
    p: Parameters, tau: np.ndarray, load: np.ndarray, start: np.ndarray, t_s: float, window: int
) -> np.ndarray:
    """Mechanical speed and angle (n, 2), in windows of so many rows from the true state at their start.

    tau and load (n,) in N·m; start (n, 4): angle, speed, twist of the shaft, speed of the load.
    """
    n, y, dy = len(tau), np.zeros(N_STATES), np.zeros(N_STATES)
    out, stages, trial = np.zeros((n, 2)), np.zeros((4, N_STATES)), np.zeros(N_STATES)
    h = t_s / SUBSTEPS
    for m in range(n):
        if m % window == 0:
            y[2], y[3], y[4], y[5] = start[m, 0], start[m, 1], start[m, 2], start[m, 3]
        out[m, 0], out[m, 1] = y[3], y[2]
        if m == n - 1:
            break
        for s in range(SUBSTEPS):
            for stage in range(4):
                share = 0.0 if stage == 0 else 0.5 if stage < 3 else 1.0
                trial[:] = y + share * h * stages[max(stage - 1, 0)]
                x = (s + share) / SUBSTEPS
                mechanics((m + x) * t_s, trial, tau[m] + x * (tau[m + 1] - tau[m]), load[m], p, dy)
                stages[stage, :] = 0.0
                stages[stage, 2:6] = dy[2:6]
                stages[stage, 12] = dy[12]
            y += h / 6.0 * (stages[0] + 2.0 * stages[1] + 2.0 * stages[2] + stages[3])
    return out


def oracle(machine: Machine, effects: Effects, manoeuvre: Manoeuvre, run: Run) -> dict[str, float]:
    """Rms that the true equations leave in a full log of a run that starts without current, per channel."""
    p, held = build(machine, effects).packed(), build(machine, effects, locked=True).packed()
    t_s, log, truth = 1.0 / machine.f_sample, run.log, run.truth
    error = np.array([angle_error(a, w, p) for a, w in zip(truth["theta_m"], truth["omega_m"], strict=True)])
    slope = np.array([angle_error_slope(a, p) for a in truth["theta_m"]])
    measured = log["theta_e"] - error
    turns = np.rint((machine.n_p * truth["theta_m"] - measured) / (2.0 * np.pi))
    theta = (measured + 2.0 * np.pi * turns) / machine.n_p
    omega = log["omega_e"] / (machine.n_p + slope)
    v = np.stack([log["v_d"], log["v_q"]], axis=1)
    i, tau = electrical(held, v, theta, omega, t_s)
    model = axes({"i_a": i[:, 0], "i_b": i[:, 1], "i_c": i[:, 2], "theta_e": log["theta_e"]})
    rest = dict(zip(("i_d", "i_q"), (a - b for a, b in zip(axes(log), model, strict=True)), strict=True))
    if not manoeuvre.locked:
        start = np.stack([truth[k] for k in ("theta_m", "omega_m", "twist", "omega_load")], axis=1)
        load = manoeuvre.tau_load[manoeuvre.settle :]
        free = motion(p, tau, load, start, t_s, round(WINDOW / t_s))
        slopes = np.array([angle_error_slope(a, p) for a in free[:, 1]])
        rest["omega_e"] = log["omega_e"] - free[:, 0] * (machine.n_p + slopes)
    return {k: float(np.sqrt(np.mean(x**2))) for k, x in rest.items()}
