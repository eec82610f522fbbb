"""The magnetic circuit of a three-phase machine as one co-energy function of phase currents and angle.

    W'(i_a, i_b, i_c, θ) = ½ Σ_xy i_x L_xy(θ) i_y + Σ_x i_x ψ_x(θ) + W_sat(i, θ)

    L_xy(θ) = L_ls δ_xy + L_A cos((x−y)γ) + L_B cos(2θ − (x+y)γ)
              + L_4 cos(4θ − 2(x+y)γ) + L_6 cos 6θ cos((x−y)γ),          γ = 2π/3, x, y ∈ {0, 1, 2}
    ψ_x(θ)  = ψ [cos θ_x + h_5 cos(5θ_x + φ_5) + h_7 cos(7θ_x + φ_7)],      θ_x = θ − xγ

Line flux linkages are its derivatives with respect to currents, torque its derivative with respect to the
mechanical angle, so both follow from one energy and the power balance closes whatever is switched on.  The
star point is isolated (i_c = −i_a − i_b): i_a and i_b are the coordinates, λ_ac and λ_bc their conjugate
fluxes.

Source: P. C. Krause et al., Analysis of Electric Machinery and Drive Systems, 3rd ed., chapters 1 and 2.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from .parameters import Parameters

GAMMA = 2.0 * math.pi / 3.0


@njit(cache=True)
def inductance(x: int, y: int, theta: float, p: Parameters) -> float:
    """L_xy(θ) in H between phases x and y (0, 1, 2) at the electrical angle theta in rad."""
    value = (p.l_air + p.l_slot6 * math.cos(6.0 * theta)) * math.cos((x - y) * GAMMA)
    value += p.l_saliency * math.cos(2.0 * theta - (x + y) * GAMMA)
    value += p.l_slot4 * math.cos(4.0 * theta - 2.0 * (x + y) * GAMMA)
    if x == y:
        value += p.l_leak
    return value


@njit(cache=True)
def inductance_slope(x: int, y: int, theta: float, p: Parameters) -> float:
    """dL_xy/dθ in H/rad."""
    value = -6.0 * p.l_slot6 * math.sin(6.0 * theta) * math.cos((x - y) * GAMMA)
    value -= 2.0 * p.l_saliency * math.sin(2.0 * theta - (x + y) * GAMMA)
    value -= 4.0 * p.l_slot4 * math.sin(4.0 * theta - 2.0 * (x + y) * GAMMA)
    return value


@njit(cache=True)
def magnet_flux(x: int, theta: float, p: Parameters) -> float:
    """ψ_x(θ) of the cold magnet in V·s."""
    a = theta - x * GAMMA
    return p.psi_m * (math.cos(a) + p.h5 * math.cos(5.0 * a + p.phase5) + p.h7 * math.cos(7.0 * a + p.phase7))


@njit(cache=True)
def magnet_flux_slope(x: int, theta: float, p: Parameters) -> float:
    """dψ_x/dθ of the cold magnet in V·s/rad."""
    a = theta - x * GAMMA
    return -p.psi_m * (
        math.sin(a) + 5.0 * p.h5 * math.sin(5.0 * a + p.phase5) + 7.0 * p.h7 * math.sin(7.0 * a + p.phase7)
    )


@njit(cache=True)
def lost_flux(u: float, l_axis: float, knee: float) -> tuple[float, float, float]:
    """Flux an axis loses to saturation at its current u (A): λ = l u / √(1 + (u/knee)²) instead of l u.

    Returns the loss of flux (V·s, signed like −u), its slope (H) and its co-energy (J); zeros for knee = 0.
    """
    if knee == 0.0:
        return 0.0, 0.0, 0.0
    s = math.sqrt(1.0 + (u / knee) ** 2)
    return (
        l_axis * u * (1.0 / s - 1.0),
        l_axis * (1.0 / s**3 - 1.0),
        l_axis * (knee**2 * (s - 1.0) - 0.5 * u * u),
    )


@njit(cache=True)
def solve_currents(
    lam_ac: float, lam_bc: float, theta: float, magnet: float, p: Parameters, i: np.ndarray
) -> None:
    """Currents that carry the line flux linkages λ_ac, λ_bc (V·s), by Newton's method on λ(i) = ∂W'/∂i.

    `i` (3, A) holds the starting guess and is overwritten.  `magnet` scales the magnet's flux (1 when cold).
    """
    l00, l11, l22 = inductance(0, 0, theta, p), inductance(1, 1, theta, p), inductance(2, 2, theta, p)
    l01, l02, l12 = inductance(0, 1, theta, p), inductance(0, 2, theta, p), inductance(1, 2, theta, p)
    m_aa = l00 - 2.0 * l02 + l22
    m_bb = l11 - 2.0 * l12 + l22
    m_ab = l01 - l02 - l12 + l22
    psi_c = magnet_flux(2, theta, p)
    psi_ac = magnet * (magnet_flux(0, theta, p) - psi_c)
    psi_bc = magnet * (magnet_flux(1, theta, p) - psi_c)
    straight = p.knee_d == 0.0 and p.knee_q == 0.0 and p.cross == 0.0
    # magnetomotive force along and across the magnet, and its share of each line coordinate
    cc, sc = math.cos(theta - 2.0 * GAMMA), math.sin(theta - 2.0 * GAMMA)
    da, db = (2.0 / 3.0) * (math.cos(theta) - cc), (2.0 / 3.0) * (math.cos(theta - GAMMA) - cc)
    qa, qb = (-2.0 / 3.0) * (math.sin(theta) - sc), (-2.0 / 3.0) * (math.sin(theta - GAMMA) - sc)
    a, b = i[0], i[1]
    for _ in range(40):
        f_a = m_aa * a + m_ab * b + psi_ac - lam_ac
        f_b = m_ab * a + m_bb * b + psi_bc - lam_bc
        j_aa, j_ab, j_bb = m_aa, m_ab, m_bb
        if not straight:
            u_d, u_q = da * a + db * b, qa * a + qb * b
            s_d, t_d, _w = lost_flux(u_d, p.l_d, p.knee_d)
            s_q, t_q, _w = lost_flux(u_q, p.l_q, p.knee_q)
            s_d -= p.cross * u_q * u_q
            s_q -= 2.0 * p.cross * u_d * u_q
            t_q -= 2.0 * p.cross * u_d
            t_x = -2.0 * p.cross * u_q
            f_a += 1.5 * (s_d * da + s_q * qa)
            f_b += 1.5 * (s_d * db + s_q * qb)
            j_aa += 1.5 * (t_d * da * da + t_q * qa * qa + 2.0 * t_x * da * qa)
            j_bb += 1.5 * (t_d * db * db + t_q * qb * qb + 2.0 * t_x * db * qb)
            j_ab += 1.5 * (t_d * da * db + t_q * qa * qb + t_x * (da * qb + db * qa))
        det = j_aa * j_bb - j_ab * j_ab
        step_a = (j_bb * f_a - j_ab * f_b) / det
        step_b = (j_aa * f_b - j_ab * f_a) / det
        a -= step_a
        b -= step_b
        if straight or abs(step_a) + abs(step_b) < 1e-12 * p.i_rated:
            break
    i[0], i[1], i[2] = a, b, -a - b


@njit(cache=True)
def torque(i: np.ndarray, theta: float, magnet: float, p: Parameters) -> float:
    """Air-gap torque ∂W'/∂θ_m in N·m of the phase currents i (3, A)."""
    t = 0.0
    for x in range(3):
        t += magnet * i[x] * magnet_flux_slope(x, theta, p)
        for y in range(3):
            t += 0.5 * i[x] * i[y] * inductance_slope(x, y, theta, p)
    u_d, u_q = axis_currents(i, theta)
    s_d, _s, _w = lost_flux(u_d, p.l_d, p.knee_d)
    s_q, _s, _w = lost_flux(u_q, p.l_q, p.knee_q)
    s_d -= p.cross * u_q * u_q
    s_q -= 2.0 * p.cross * u_d * u_q
    # ∂u_d/∂θ = u_q and ∂u_q/∂θ = −u_d at fixed phase currents
    t += 1.5 * (s_d * u_q - s_q * u_d)
    return p.n_p * t


@njit(cache=True)
def axis_currents(i: np.ndarray, theta: float) -> tuple[float, float]:
    """Phase currents (3, A) projected on the magnet's axis and across it, amplitude invariant."""
    d, q = 0.0, 0.0
    for x in range(3):
        d += i[x] * math.cos(theta - x * GAMMA)
        q -= i[x] * math.sin(theta - x * GAMMA)
    return 2.0 / 3.0 * d, 2.0 / 3.0 * q


@njit(cache=True)
def field_energy(
    i: np.ndarray, lam_ac: float, lam_bc: float, theta: float, magnet: float, p: Parameters
) -> float:
    """Energy Σ λ i − W' stored in the field, in J, relative to the machine without current."""
    w = 0.0
    for x in range(3):
        w += magnet * i[x] * magnet_flux(x, theta, p)
        for y in range(3):
            w += 0.5 * i[x] * i[y] * inductance(x, y, theta, p)
    u_d, u_q = axis_currents(i, theta)
    w += 1.5 * (lost_flux(u_d, p.l_d, p.knee_d)[2] + lost_flux(u_q, p.l_q, p.knee_q)[2])
    w -= 1.5 * p.cross * u_d * u_q * u_q
    return lam_ac * i[0] + lam_bc * i[1] - w
