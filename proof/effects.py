"""The effects that can be switched on: their parameters, and what they make of the plant's numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping

from .foreign import FORMS
from .parameters import Machine, Parameters

Effects = Mapping[str, Mapping[str, float]]

# effect -> its parameters with their defaults; names of the package's catalogue where it fixes them
CATALOGUE: dict[str, dict[str, float]] = {
    "coulomb_friction": {"tau_c": 0.0, "w_smooth": 0.05},
    "stribeck_friction": {"tau_c": 0.0, "tau_s": 0.0, "w_s": 5.0, "w_smooth": 0.05},
    "asymmetric_friction": {"tau_c_pos": 0.0, "tau_c_neg": 0.0, "b_pos": 0.0, "b_neg": 0.0, "w_smooth": 0.05},
    "load_dependent_friction": {"mu": 0.0, "w_smooth": 0.05},
    "quadratic_drag": {"k": 0.0},
    "cogging_torque": {"tau_cog": 0.0, "order_mech": 24.0, "phase": 0.0, "second_rel": 0.0},
    "cogging_asymmetry": {
        "tau_slots": 0.0,
        "order_slots": 12.0,
        "phase_s": 0.0,
        "tau_poles": 0.0,
        "phase_p": 0.0,
    },
    "load_torque_pulsation": {"tau_pul": 0.0, "per_rev": 1.0, "phase": 0.0},
    "gravity_torque": {"tau_g": 0.0, "phase": 0.0},
    "time_varying_load": {"amplitude": 0.0, "f": 2.0, "phase": 0.0},
    "two_mass_shaft": {"f_antires": 0.0, "f_res": 0.0, "damping": 0.02},
    "back_emf_harmonics": {"e5_rel": 0.0, "e7_rel": 0.0, "phase5": 0.0, "phase7": 0.0},
    "saturation_d": {"drop_at_rated": 0.0},
    "saturation_q": {"drop_at_rated": 0.0},
    "cross_saturation": {"psi_drop_at_rated": 0.0},
    "inductance_harmonics": {"rel_6": 0.0, "rel_4": 0.0},
    "rs_thermal_drift": {"rise_at_rated": 0.0, "tau": 2.0},
    "magnet_thermal_drift": {"psi_drop_final": 0.0, "tau": 2.0, "speed_share": 0.0},
    "iron_loss": {"r_c": 0.0, "leakage_share": 0.15},
    "dead_time": {"v_err": 0.0, "i_th": 0.0, "r_on": 0.0},
    "voltage_delay": {"extra_samples": 0.0},
    "dc_link_sag": {"r_source": 0.0, "c_dc": 1e-3},
    "phase_resistance_imbalance": {"r_excess_rel": 0.0, "phase_index": 0.0},
    "inter_turn_short": {"share": 0.0, "r_fault": 1.0},
    "current_offset": {"o_a": 0.0, "o_b": 0.0, "o_c": 0.0},
    "current_gain_imbalance": {"g_a": 0.0, "g_b": 0.0, "g_c": 0.0},
    "encoder_angle_offset": {"offset_el_rad": 0.0},
    "encoder_delay": {"t_delay": 0.0},
    "encoder_eccentricity": {"amplitude_el_rad": 0.0, "phase": 0.0},
    "encoder_harmonics": {
        "amplitude_1_el_rad": 0.0,
        "phase_1": 0.0,
        "amplitude_2_el_rad": 0.0,
        "phase_2": 0.0,
    },
    # outside the package's catalogue
    **{name: form.parameters for name, form in FORMS.items()},
}

# effect -> effects of the package's catalogue that are a part of it: friction of two levels is
# Coulomb friction of their mean, and what differs by direction
HOLDS: dict[str, tuple[str, ...]] = {"asymmetric_friction": ("coulomb_friction",)}

# equation in which each effect shows, as the answer's `located` names it; the first is the main one
EQUATION: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(
        (
            "coulomb_friction",
            "stribeck_friction",
            "asymmetric_friction",
            "load_dependent_friction",
            "quadratic_drag",
            "cogging_torque",
            "cogging_asymmetry",
            "load_torque_pulsation",
            "gravity_torque",
            "time_varying_load",
            "two_mass_shaft",
        ),
        ("mechanical",),
    ),
    **dict.fromkeys(
        (
            "back_emf_harmonics",
            "saturation_q",
            "inductance_harmonics",
            "rs_thermal_drift",
            "magnet_thermal_drift",
            "dead_time",
            "dc_link_sag",
            "phase_resistance_imbalance",
            "inter_turn_short",
        ),
        ("q", "d"),
    ),
    **dict.fromkeys(("saturation_d", "cross_saturation", "iron_loss", "voltage_delay"), ("d", "q")),
    **dict.fromkeys(
        (
            "current_offset",
            "current_gain_imbalance",
            "encoder_angle_offset",
            "encoder_delay",
            "encoder_eccentricity",
            "encoder_harmonics",
        ),
        ("sensor",),
    ),
    **{name: form.equations for name, form in FORMS.items()},
}
# effects of which only one has a state in the magnetic circuit
ONE_OF = ("iron_loss", "inter_turn_short", "x_sleeve_current", "x_flux_hysteresis")
# effects that both need the second mass
ONE_LOAD = ("two_mass_shaft", "x_backlash")


def effect_values(effects: Effects) -> dict[str, dict[str, float]]:
    """Fill in defaults.  Raises KeyError for an effect or a parameter that does not exist."""
    out: dict[str, dict[str, float]] = {}
    for name, given in effects.items():
        known = CATALOGUE[name]
        unknown = set(given) - set(known)
        if unknown:
            raise KeyError(f"{name} has no parameter {sorted(unknown)}; it has {sorted(known)}")
        out[name] = {**known, **given}
    return out


def knee(drop: float, i_rated: float) -> float:
    """Knee current (A) at which 1/√(1 + (i_rated/knee)²) = 1 − drop; 0 for no drop."""
    return 0.0 if drop == 0.0 else i_rated / math.sqrt((1.0 - drop) ** -2 - 1.0)


def build(machine: Machine, effects: Effects, *, locked: bool = False) -> Parameters:
    """Parameters of the plant.  An effect at strength zero gives the same numbers where they matter as
    none."""
    m, e = machine, effect_values(effects)
    for group in (ONE_OF, ONE_LOAD):
        if len(both := [k for k in group if k in e]) > 1:
            raise ValueError(f"{' and '.join(both)} cannot be switched on together")
    iron = e.get("iron_loss", CATALOGUE["iron_loss"])
    share = iron["leakage_share"] if iron["r_c"] > 0.0 else CATALOGUE["iron_loss"]["leakage_share"]
    leak = share * min(m.l_d, m.l_q)
    p: dict[str, float] = {
        "r_s": m.r_s,
        "l_d": m.l_d,
        "l_q": m.l_q,
        "psi_m": m.psi_m,
        "n_p": float(m.n_p),
        "j": m.j,
        "b": m.b,
        "i_rated": m.i_rated,
        "w_rated": m.w_rated,
        "v_dc": m.v_dc,
        "l_leak": leak,
        "l_air": (m.l_d + m.l_q - 2.0 * leak) / 3.0,
        "l_saliency": (m.l_d - m.l_q) / 3.0,
        "locked": float(locked),
    }
    smooth = [v["w_smooth"] for v in e.values() if "w_smooth" in v]
    if smooth:
        p["w_smooth"] = min(smooth)
    for name, v in e.items():
        if name == "coulomb_friction":
            p["tau_c"] = v["tau_c"]
        elif name == "stribeck_friction":
            p.update(tau_c=v["tau_c"], tau_s=v["tau_s"] - v["tau_c"], w_s=v["w_s"])
        elif name == "asymmetric_friction":
            p.update({k: v[k] for k in ("tau_c_pos", "tau_c_neg", "b_pos", "b_neg")})
        elif name == "load_dependent_friction":
            p["mu_load"] = v["mu"]
        elif name == "quadratic_drag":
            p["drag"] = v["k"]
        elif name == "cogging_torque":
            p.update(tau_cog=v["tau_cog"], order_cog=v["order_mech"], phase_cog=v["phase"])
            p["second_cog"] = v["second_rel"]
        elif name == "cogging_asymmetry":
            p.update(tau_slots=v["tau_slots"], order_slots=v["order_slots"], phase_slots=v["phase_s"])
            p.update(tau_poles=v["tau_poles"], phase_poles=v["phase_p"])
        elif name == "load_torque_pulsation":
            p.update(tau_pul=v["tau_pul"], order_pul=v["per_rev"], phase_pul=v["phase"])
        elif name == "gravity_torque":
            p.update(tau_grav=v["tau_g"], phase_grav=v["phase"])
        elif name == "time_varying_load":
            p.update(tau_var=v["amplitude"], f_var=v["f"], phase_var=v["phase"])
        elif name == "two_mass_shaft" and v["f_antires"] > 0.0:
            if v["f_res"] <= v["f_antires"]:
                raise ValueError("two_mass_shaft: f_res must lie above f_antires")
            j_load = m.j * (1.0 - (v["f_antires"] / v["f_res"]) ** 2)
            w = 2.0 * math.pi * v["f_antires"]
            p.update(j_load=j_load, k_shaft=j_load * w * w, d_shaft=2.0 * v["damping"] * j_load * w)
        elif name == "back_emf_harmonics":
            p.update(h5=v["e5_rel"] / 5.0, h7=v["e7_rel"] / 7.0, phase5=v["phase5"], phase7=v["phase7"])
        elif name == "saturation_d":
            p["knee_d"] = knee(v["drop_at_rated"], m.i_rated)
        elif name == "saturation_q":
            p["knee_q"] = knee(v["drop_at_rated"], m.i_rated)
        elif name == "cross_saturation":
            p["cross"] = v["psi_drop_at_rated"] * m.psi_m / m.i_rated**2
        elif name == "inductance_harmonics":
            mean = 0.5 * (m.l_d + m.l_q)
            p.update(l_slot6=v["rel_6"] * mean / 1.5, l_slot4=v["rel_4"] * mean / 1.5)
        elif name == "rs_thermal_drift":
            p.update(rs_rise=v["rise_at_rated"], rs_tau=v["tau"])
        elif name == "magnet_thermal_drift":
            p.update(psi_drop=v["psi_drop_final"], psi_tau=v["tau"], psi_speed_share=v["speed_share"])
        elif name == "iron_loss":
            # the leakage leaves the magnetic circuit and stands in series with the iron's branch
            if v["r_c"] > 0.0:
                p.update(r_c=v["r_c"], l_leak=0.0, l_series=leak)
        elif name == "dead_time":
            # the current ripple of a real leg smears the sign over a few per cent of the rated current
            p.update(v_err=v["v_err"], i_th=v["i_th"] or 0.02 * m.i_rated, r_on=v["r_on"])
        elif name == "voltage_delay":
            p["delay"] = v["extra_samples"] / m.f_sample
        elif name == "dc_link_sag":
            p.update(r_source=v["r_source"], c_dc=v["c_dc"])
        elif name == "phase_resistance_imbalance":
            p["excess_" + "abc"[int(v["phase_index"])]] = v["r_excess_rel"]
        elif name == "inter_turn_short":
            p.update(short_share=v["share"], short_r=v["r_fault"])
        elif name in ("current_offset", "current_gain_imbalance"):
            p.update(v)
        elif name == "encoder_angle_offset":
            p["angle_offset"] = v["offset_el_rad"]
        elif name == "encoder_delay":
            p["delay_angle"] = v["t_delay"]
        elif name == "encoder_eccentricity":
            p.update(eccentricity=v["amplitude_el_rad"], phase_ecc=v["phase"])
        elif name == "encoder_harmonics":
            p.update(skew_1=v["amplitude_1_el_rad"], phase_skew_1=v["phase_1"])
            p.update(skew_2=v["amplitude_2_el_rad"], phase_skew_2=v["phase_2"])
        elif name in FORMS:
            p.update(FORMS[name].plant(m, v))
    return Parameters(**p)
