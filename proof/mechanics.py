"""Torques on the rotor and on a load behind a shaft or a play; states as in `dynamics`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from .parameters import Parameters


@njit(cache=True)
def short_way(angle: float) -> float:
    """The angle (rad) less whole turns, between -pi and pi."""
    return angle - 2.0 * math.pi * np.rint(angle / (2.0 * math.pi))


@njit(cache=True)
def contact(twist: float, slip: float, p: Parameters) -> float:
    """Torque (N·m) across the play at a twist (rad) and a slip (rad/s); a contact pushes and never pulls."""
    push = abs(twist) - 0.5 * p.gap
    if push <= 0.0:
        return 0.0
    side = 1.0 if twist > 0.0 else -1.0
    return side * max(0.0, p.k_shaft * push + p.d_shaft * slip * side)


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
        friction += p.tau_rub * math.exp(-((short_way(th - p.place_rub) / p.width_rub) ** 2)) * sign
    if p.tau_hump != 0.0:
        friction += p.tau_hump * math.exp(-(((abs(w) - p.w_hump) / p.width_hump) ** 2)) * sign
    dy[12] = 0.0
    if p.k_eddy != 0.0:
        friction += p.k_eddy * w / (1.0 + (w / p.w_eddy) ** 2)
    if p.k_root != 0.0:
        # the root's slope at standstill is bounded by the same speed as that of dry friction
        friction += p.k_root * w / (w * w + p.w_smooth**2) ** 0.25
    if p.tau_dahl != 0.0:
        friction += p.tau_dahl * y[12] / p.theta_dahl
        dy[12] = w - abs(w) * y[12] / p.theta_dahl
    if p.tau_lean != 0.0:
        friction += p.tau_lean * (1.0 + math.cos(th + p.phase_lean)) * sign
    if p.mu_mesh != 0.0:
        friction += p.mu_mesh * abs(tau_e) * math.tanh(4.0 * math.sin(p.teeth * th + p.phase_mesh)) * sign
    rotor, load = tau_e - friction, tau_load
    if p.tau_cam != 0.0:
        away = short_way(th - p.place_cam) / p.width_cam
        if abs(away) < 1.0:
            load += 0.5 * p.tau_cam * (1.0 + math.cos(math.pi * away))
    if p.tau_cog != 0.0:
        a = p.order_cog * th + p.phase_cog
        rotor += p.tau_cog * (math.cos(a) + p.second_cog * math.cos(2.0 * a))
    if p.tau_slots != 0.0:
        rotor += p.tau_slots * math.cos(p.order_slots * th + p.phase_slots)
    if p.tau_poles != 0.0:
        rotor += p.tau_poles * math.cos(2.0 * p.n_p * th + p.phase_poles)
    if p.tau_pul != 0.0:
        load += p.tau_pul * math.cos(p.order_pul * (th - y[4]) + p.phase_pul)
    if p.tau_grav != 0.0:
        load += p.tau_grav * math.cos(th - y[4] + p.phase_grav)
    if p.tau_var != 0.0:
        load += p.tau_var * math.sin(2.0 * math.pi * p.f_var * t + p.phase_var)
    dy[2], dy[4], dy[5] = w, 0.0, 0.0
    if p.locked != 0.0:
        dy[3] = 0.0
    elif p.j_load > 0.0:
        shaft = p.k_shaft * y[4] + p.d_shaft * (w - y[5])
        if p.gap > 0.0:
            shaft = contact(y[4], w - y[5], p)
        dy[3] = (rotor - shaft) / (p.j - p.j_load)
        dy[4] = w - y[5]
        dy[5] = (shaft - load) / p.j_load
    else:
        dy[3] = (rotor - load) / p.j
