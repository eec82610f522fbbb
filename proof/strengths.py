"""How strong each effect is made, in the machine's own units."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .parameters import Machine

Values = dict[str, dict[str, float]]
Rule = Callable[[Machine, float, Callable[[float, float], float], np.random.Generator], dict[str, float]]


def spread(machine: Machine, s: float, rng: np.random.Generator, size: float, names: str) -> dict[str, float]:
    """Three values of size·s whose mean is zero: a common part would be another machine, not a fault."""
    x = rng.standard_normal(3)
    x -= x.mean()
    x *= size * s / np.abs(x).max()
    return {f"{names}_{phase}": float(v) for phase, v in zip("abc", x, strict=True)}


def slots(machine: Machine, rng: np.random.Generator) -> float:
    """A number of slots of a three-phase winding, no multiple of the poles."""
    poles = 2 * machine.n_p
    return float(rng.choice([q for q in range(6, 49, 3) if q % poles]))


# effect -> (greatest s, parameters at strength s); s = 1 is a moderate case in the machine's own units:
# torque against rated torque, voltage against the DC link, inductance and flux against themselves
RULES: dict[str, tuple[float, Rule]] = {
    "coulomb_friction": (5, lambda m, s, u, g: {"tau_c": 0.03 * s * m.tau_rated}),
    "stribeck_friction": (
        5,
        lambda m, s, u, g: {
            "tau_c": 0.02 * s * m.tau_rated,
            "tau_s": 0.02 * s * m.tau_rated * u(1.6, 3.0),
            "w_s": u(0.02, 0.1) * m.w_rated,
        },
    ),
    "asymmetric_friction": (
        5,
        lambda m, s, u, g: {
            "tau_c_pos": 0.03 * s * m.tau_rated,
            "tau_c_neg": 0.03 * s * m.tau_rated * (u(0.2, 0.6) if u(0, 1) < 0.5 else u(1.5, 3.0)),
        },
    ),
    "load_dependent_friction": (5, lambda m, s, u, g: {"mu": 0.05 * s}),
    "quadratic_drag": (8, lambda m, s, u, g: {"k": 0.05 * s * m.tau_rated / m.w_rated**2}),
    "cogging_torque": (
        8,
        lambda m, s, u, g: {
            "tau_cog": 0.02 * s * m.tau_rated,
            "order_mech": float(m.n_p * g.choice([2, 4, 6])),
            "phase": u(-math.pi, math.pi),
            "second_rel": u(0.0, 0.4),
        },
    ),
    "cogging_asymmetry": (
        8,
        lambda m, s, u, g: {
            "tau_slots": 0.02 * s * m.tau_rated,
            "order_slots": slots(m, g),
            "phase_s": u(-math.pi, math.pi),
            "tau_poles": 0.02 * s * m.tau_rated * u(0.0, 0.6),
            "phase_p": u(-math.pi, math.pi),
        },
    ),
    "load_torque_pulsation": (
        8,
        lambda m, s, u, g: {
            "tau_pul": 0.03 * s * m.tau_rated,
            "per_rev": float(g.choice([1, 1, 2, 3])),
            "phase": u(-math.pi, math.pi),
        },
    ),
    "time_varying_load": (
        8,
        lambda m, s, u, g: {
            "amplitude": 0.05 * s * m.tau_rated,
            "f": u(1.5, 8.0),
            "phase": u(-math.pi, math.pi),
        },
    ),
    "two_mass_shaft": (
        8,
        lambda m, s, u, g: {
            "f_antires": (f := u(20.0, 80.0)),
            "f_res": f * (1.0 + 0.25 * s),
            "damping": u(0.01, 0.05),
        },
    ),
    "back_emf_harmonics": (
        5,
        lambda m, s, u, g: {
            "phase5": (math.pi if g.choice([-1, 1]) < 0 else 0.0),
            "phase7": (math.pi if (e7 := u(-0.8, 0.8)) < 0 else 0.0),
            "e5_rel": 0.03 * s,
            "e7_rel": abs(e7) * 0.03 * s,
        },
    ),
    "saturation_d": (5, lambda m, s, u, g: {"drop_at_rated": 0.1 * s}),
    "saturation_q": (5, lambda m, s, u, g: {"drop_at_rated": 0.1 * s}),
    "cross_saturation": (5, lambda m, s, u, g: {"psi_drop_at_rated": 0.05 * s}),
    "inductance_harmonics": (5, lambda m, s, u, g: {"rel_6": 0.05 * s, "rel_4": u(0.0, 0.5) * 0.05 * s}),
    "rs_thermal_drift": (3, lambda m, s, u, g: {"rise_at_rated": 0.3 * s, "tau": u(0.5, 2.0)}),
    "magnet_thermal_drift": (
        5,
        lambda m, s, u, g: {"psi_drop_final": 0.04 * s, "tau": u(0.5, 2.0), "speed_share": u(0.0, 0.5)},
    ),
    "iron_loss": (8, lambda m, s, u, g: {"r_c": m.w_rated * m.n_p * m.psi_m / (0.03 * s * m.i_rated)}),
    "dead_time": (6, lambda m, s, u, g: {"v_err": 0.004 * s * m.v_dc}),
    "voltage_delay": (4, lambda m, s, u, g: {"extra_samples": 0.25 * s}),
    "dc_link_sag": (
        5,
        lambda m, s, u, g: {
            "r_source": 0.04 * s * m.v_dc**2 / (m.tau_rated * m.w_rated),
            "c_dc": u(0.5e-3, 3e-3),
        },
    ),
    "phase_resistance_imbalance": (
        8,
        lambda m, s, u, g: {"r_excess_rel": 0.1 * s, "phase_index": float(g.integers(3))},
    ),
    "inter_turn_short": (5, lambda m, s, u, g: {"share": 0.03 * s, "r_fault": u(0.2, 1.0) * m.r_s}),
    "current_offset": (6, lambda m, s, u, g: spread(m, s, g, 0.005 * m.i_rated, "o")),
    "current_gain_imbalance": (6, lambda m, s, u, g: spread(m, s, g, 0.02, "g")),
    "encoder_angle_offset": (8, lambda m, s, u, g: {"offset_el_rad": float(g.choice([-1, 1])) * 0.03 * s}),
    "encoder_delay": (8, lambda m, s, u, g: {"t_delay": 0.25 * s / m.f_sample}),
    "encoder_eccentricity": (
        6,
        lambda m, s, u, g: {"amplitude_el_rad": 0.03 * s, "phase": u(-math.pi, math.pi)},
    ),
    "x_tight_spot": (
        40,
        lambda m, s, u, g: {
            "tau": 0.1 * s * m.tau_rated,
            "width": u(0.2, 0.5),
            "place": u(-math.pi, math.pi),
        },
    ),
    "x_friction_hump": (
        12,
        lambda m, s, u, g: {
            "tau": 0.05 * s * m.tau_rated,
            "w_hump": u(0.25, 0.45) * m.w_rated,
            "width": u(0.04, 0.08) * m.w_rated,
        },
    ),
    "x_weak_leg": (15, lambda m, s, u, g: {"loss_rel": 0.01 * s}),
    "x_loose_terminal": (30, lambda m, s, u, g: {"r_extra": 0.3 * s * m.r_s, "f": u(3.0, 15.0)}),
    # the greatest brakes with 0.4 of the rated torque at its critical speed
    "x_eddy_brake": (
        8,
        lambda m, s, u, g: {
            "k": 2.0 * 0.05 * s * m.tau_rated / (w := u(0.1, 0.5) * m.w_rated),
            "w_critical": w,
        },
    ),
    "x_root_friction": (8, lambda m, s, u, g: {"k": 0.05 * s * m.tau_rated / math.sqrt(m.w_rated)}),
    "x_dahl_presliding": (
        8,
        lambda m, s, u, g: {"tau_c": 0.05 * s * m.tau_rated, "theta_0": math.exp(u(-4.0, -1.0))},
    ),
    "x_backlash": (
        8,
        lambda m, s, u, g: {
            "gap": 0.02 * s,
            "load_share": u(0.2, 0.6),
            "f_contact": u(80.0, 200.0),
            "damping": u(0.05, 0.3),
        },
    ),
    "x_cam_load": (
        12,
        lambda m, s, u, g: {
            "tau": 0.05 * s * m.tau_rated,
            "width": u(0.5, 1.2),
            "place": u(-math.pi, math.pi),
        },
    ),
    "x_angle_friction": (
        6,
        lambda m, s, u, g: {"tau": 0.05 * s * m.tau_rated, "phase": u(-math.pi, math.pi)},
    ),
    "x_gear_mesh": (
        8,
        lambda m, s, u, g: {"mu": 0.1 * s, "teeth": float(g.integers(5, 12)), "phase": u(-math.pi, math.pi)},
    ),
    "x_sleeve_current": (8, lambda m, s, u, g: {"l_rel": 0.2 * s, "tau_rel": u(3.0, 15.0)}),
    "x_rectifier_ripple": (
        12,
        lambda m, s, u, g: {"ripple_rel": 0.02 * s, "f": float(g.choice([100.0, 300.0]))},
    ),
    "x_flux_hysteresis": (8, lambda m, s, u, g: {"i_rel": 0.01 * s, "flux_rel": u(0.1, 0.6)}),
    "x_current_lag": (8, lambda m, s, u, g: {"lag": 0.25 * s / m.f_sample}),
    "x_converter_skew": (8, lambda m, s, u, g: {"skew": 0.05 * s / m.f_sample}),
    "x_sensor_bow": (6, lambda m, s, u, g: {"loss_at_rated": 0.02 * s}),
    "x_late_angle": (8, lambda m, s, u, g: {"t_rated": 0.25 * s / m.f_sample}),
    "x_disc_flaw": (
        12,
        lambda m, s, u, g: {
            "amplitude_el_rad": float(g.choice([-1, 1])) * 0.03 * s,
            "width": u(0.3, 0.8),
            "place": u(-math.pi, math.pi),
        },
    ),
}
