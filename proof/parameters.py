"""What the plant is made of: machine data, bench quality, and the numbers of its differential equations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


@dataclass(frozen=True)
class Machine:
    """True values of a machine and of the bench it stands on.

    r_s ohm, l_d and l_q H, psi_m V·s peak, n_p pole pairs, j kg·m², b N·m·s, i_rated A peak, w_rated rad/s
    mechanical, v_dc V, f_sample Hz.  Bench: noise_i A and lsb_i A per phase current, noise_w electrical
    rad/s, encoder_bits per mechanical turn, noise_tau N·m of a torque transducer.
    """

    name: str
    r_s: float
    l_d: float
    l_q: float
    psi_m: float
    n_p: int
    j: float
    b: float
    i_rated: float
    w_rated: float
    v_dc: float
    f_sample: float
    noise_i: float
    lsb_i: float
    noise_w: float
    encoder_bits: int
    noise_tau: float = 0.0

    @property
    def tau_rated(self) -> float:
        """Torque at rated current with i_d = 0, in N·m."""
        return 1.5 * self.n_p * self.psi_m * self.i_rated

    @property
    def lsb_theta_e(self) -> float:
        """Resolution of the encoder in electrical rad."""
        return 2.0 * math.pi * self.n_p / 2**self.encoder_bits


class Parameters(NamedTuple):
    """All numbers of the differential equations; zero switches an effect off.  Only floats, for the
    compiler."""

    r_s: float
    l_d: float
    l_q: float
    psi_m: float
    n_p: float
    j: float
    b: float
    i_rated: float
    w_rated: float
    v_dc: float
    # co-energy
    l_leak: float
    l_air: float
    l_saliency: float
    l_series: float = 0.0
    l_slot4: float = 0.0
    l_slot6: float = 0.0
    h5: float = 0.0
    phase5: float = 0.0
    h7: float = 0.0
    phase7: float = 0.0
    knee_d: float = 0.0
    knee_q: float = 0.0
    cross: float = 0.0
    # windings
    excess_a: float = 0.0
    excess_b: float = 0.0
    excess_c: float = 0.0
    r_loose: float = 0.0
    f_loose: float = 1.0
    rs_rise: float = 0.0
    rs_tau: float = 1.0
    psi_drop: float = 0.0
    psi_tau: float = 1.0
    psi_speed_share: float = 0.0
    r_c: float = 0.0
    short_share: float = 0.0
    short_r: float = 1.0
    r_sleeve: float = 0.0
    l_sleeve: float = 1.0
    i_hyst: float = 0.0
    flux_hyst: float = 1.0
    # inverter
    v_err: float = 0.0
    i_th: float = 1.0
    r_on: float = 0.0
    delay: float = 0.0
    leg_loss: float = 0.0
    r_source: float = 0.0
    c_dc: float = 1e-3
    ripple: float = 0.0
    f_ripple: float = 1.0
    # mechanics
    tau_c: float = 0.0
    tau_s: float = 0.0
    w_s: float = 1.0
    tau_c_pos: float = 0.0
    tau_c_neg: float = 0.0
    b_pos: float = 0.0
    b_neg: float = 0.0
    mu_load: float = 0.0
    w_smooth: float = 0.05
    drag: float = 0.0
    tau_cog: float = 0.0
    order_cog: float = 1.0
    phase_cog: float = 0.0
    second_cog: float = 0.0
    tau_slots: float = 0.0
    order_slots: float = 12.0
    phase_slots: float = 0.0
    tau_poles: float = 0.0
    phase_poles: float = 0.0
    tau_pul: float = 0.0
    order_pul: float = 1.0
    phase_pul: float = 0.0
    tau_grav: float = 0.0
    phase_grav: float = 0.0
    tau_var: float = 0.0
    f_var: float = 1.0
    phase_var: float = 0.0
    tau_rub: float = 0.0
    width_rub: float = 1.0
    place_rub: float = 0.0
    tau_hump: float = 0.0
    w_hump: float = 0.0
    width_hump: float = 1.0
    k_eddy: float = 0.0
    w_eddy: float = 1.0
    k_root: float = 0.0
    tau_dahl: float = 0.0
    theta_dahl: float = 1.0
    tau_cam: float = 0.0
    width_cam: float = 1.0
    place_cam: float = 0.0
    tau_lean: float = 0.0
    phase_lean: float = 0.0
    mu_mesh: float = 0.0
    teeth: float = 1.0
    phase_mesh: float = 0.0
    j_load: float = 0.0
    k_shaft: float = 0.0
    d_shaft: float = 0.0
    gap: float = 0.0
    locked: float = 0.0
    # measurement
    o_a: float = 0.0
    o_b: float = 0.0
    o_c: float = 0.0
    g_a: float = 0.0
    g_b: float = 0.0
    g_c: float = 0.0
    angle_offset: float = 0.0
    eccentricity: float = 0.0
    phase_ecc: float = 0.0
    skew_1: float = 0.0
    phase_skew_1: float = 0.0
    skew_2: float = 0.0
    phase_skew_2: float = 0.0
    late: float = 0.0
    delay_angle: float = 0.0
    flaw: float = 0.0
    width_flaw: float = 1.0
    place_flaw: float = 0.0
    lag_i: float = 0.0
    skew_i: float = 0.0
    bow_i: float = 0.0

    def packed(self) -> np.void:
        """The same numbers as one record, of which compiled code is given the address, not a copy."""
        return np.array([tuple(self)], dtype=[(name, float) for name in self._fields])[0]
