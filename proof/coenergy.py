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

    Three = tuple[float, float, float]
    Angles = tuple[Three, Three, float, float]

HALF_SQRT3 = 0.5 * math.sqrt(3.0)


@njit(cache=True)
def angles(theta: float) -> Angles:
    """cos θ_x and sin θ_x of the three phases, cos 6θ and sin 6θ, of the electrical angle theta in rad.

    All other angles of the module follow from these by addition theorems.
    """
    c, s = math.cos(theta), math.sin(theta)
    c2, s2 = c * c - s * s, 2.0 * s * c
    cosines = c, -0.5 * c + HALF_SQRT3 * s, -0.5 * c - HALF_SQRT3 * s
    sines = s, -0.5 * s - HALF_SQRT3 * c, -0.5 * s + HALF_SQRT3 * c
    return cosines, sines, c2 * (4.0 * c2 * c2 - 3.0), s2 * (3.0 - 4.0 * s2 * s2)


@njit(cache=True)
def twice(x: int, y: int, at: Angles) -> tuple[float, float]:
    """Cosine and sine of 2θ − (x+y)γ, which is 2θ_z for the phase z = 2(x+y) mod 3."""
    z = 2 * (x + y) % 3
    c, s = at[0][z], at[1][z]
    return c * c - s * s, 2.0 * s * c


@njit(cache=True)
def inductance(x: int, y: int, at: Angles, p: Parameters) -> float:
    """L_xy(θ) in H between phases x and y (0, 1, 2)."""
    c, s = twice(x, y, at)
    value = (p.l_air + p.l_slot6 * at[2]) * (1.0 if x == y else -0.5)
    value += p.l_saliency * c + p.l_slot4 * (c * c - s * s)
    return value + p.l_leak if x == y else value


@njit(cache=True)
def inductance_slope(x: int, y: int, at: Angles, p: Parameters) -> float:
    """dL_xy/dθ in H/rad."""
    c, s = twice(x, y, at)
    value = -6.0 * p.l_slot6 * at[3] * (1.0 if x == y else -0.5)
    return value - 2.0 * p.l_saliency * s - 8.0 * p.l_slot4 * s * c


@njit(cache=True)
def harmonics(x: int, at: Angles, p: Parameters) -> tuple[float, float, float, float]:
    """Cosine and sine of 5θ_x + φ_5, then of 7θ_x + φ_7: 6θ less and plus θ_x, for 6θ_x = 6θ − 4πx."""
    c, s = at[0][x], at[1][x]
    c5, s5 = at[2] * c + at[3] * s, at[3] * c - at[2] * s
    c7, s7 = at[2] * c - at[3] * s, at[3] * c + at[2] * s
    p5, q5, p7, q7 = math.cos(p.phase5), math.sin(p.phase5), math.cos(p.phase7), math.sin(p.phase7)
    return c5 * p5 - s5 * q5, s5 * p5 + c5 * q5, c7 * p7 - s7 * q7, s7 * p7 + c7 * q7


@njit(cache=True)
def magnet_flux(x: int, at: Angles, p: Parameters) -> float:
    """ψ_x(θ) of the cold magnet in V·s."""
    flux = at[0][x]
    if p.h5 != 0.0 or p.h7 != 0.0:
        c5, _s5, c7, _s7 = harmonics(x, at, p)
        flux += p.h5 * c5 + p.h7 * c7
    return p.psi_m * flux


@njit(cache=True)
def magnet_flux_slope(x: int, at: Angles, p: Parameters) -> float:
    """dψ_x/dθ of the cold magnet in V·s/rad."""
    slope = at[1][x]
    if p.h5 != 0.0 or p.h7 != 0.0:
        _c5, s5, _c7, s7 = harmonics(x, at, p)
        slope += 5.0 * p.h5 * s5 + 7.0 * p.h7 * s7
    return -p.psi_m * slope


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
    at = angles(theta)
    l00, l11, l22 = inductance(0, 0, at, p), inductance(1, 1, at, p), inductance(2, 2, at, p)
    l01, l02, l12 = inductance(0, 1, at, p), inductance(0, 2, at, p), inductance(1, 2, at, p)
    m_aa = l00 - 2.0 * l02 + l22
    m_bb = l11 - 2.0 * l12 + l22
    m_ab = l01 - l02 - l12 + l22
    psi_c = magnet_flux(2, at, p)
    psi_ac = magnet * (magnet_flux(0, at, p) - psi_c)
    psi_bc = magnet * (magnet_flux(1, at, p) - psi_c)
    straight = p.knee_d == 0.0 and p.knee_q == 0.0 and p.cross == 0.0
    # magnetomotive force along and across the magnet, and its share of each line coordinate
    c, s = at[0], at[1]
    da, db = (2.0 / 3.0) * (c[0] - c[2]), (2.0 / 3.0) * (c[1] - c[2])
    qa, qb = (-2.0 / 3.0) * (s[0] - s[2]), (-2.0 / 3.0) * (s[1] - s[2])
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
    t, at = 0.0, angles(theta)
    for x in range(3):
        t += magnet * i[x] * magnet_flux_slope(x, at, p)
        for y in range(3):
            t += 0.5 * i[x] * i[y] * inductance_slope(x, y, at, p)
    u_d, u_q = along(i, at)
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
    return along(i, angles(theta))


@njit(cache=True)
def along(i: np.ndarray, at: Angles) -> tuple[float, float]:
    """As `axis_currents`, of an angle's cosines and sines."""
    c, s = at[0], at[1]
    d = i[0] * c[0] + i[1] * c[1] + i[2] * c[2]
    q = i[0] * s[0] + i[1] * s[1] + i[2] * s[2]
    return 2.0 / 3.0 * d, -2.0 / 3.0 * q


@njit(cache=True)
def field_energy(
    i: np.ndarray, lam_ac: float, lam_bc: float, theta: float, magnet: float, p: Parameters
) -> float:
    """Energy Σ λ i − W' stored in the field, in J, relative to the machine without current."""
    w, at = 0.0, angles(theta)
    for x in range(3):
        w += magnet * i[x] * magnet_flux(x, at, p)
        for y in range(3):
            w += 0.5 * i[x] * i[y] * inductance(x, y, at, p)
    u_d, u_q = along(i, at)
    w += 1.5 * (lost_flux(u_d, p.l_d, p.knee_d)[2] + lost_flux(u_q, p.l_q, p.knee_q)[2])
    w -= 1.5 * p.cross * u_d * u_q * u_q
    return lam_ac * i[0] + lam_bc * i[1] - w
